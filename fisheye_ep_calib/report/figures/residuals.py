"""Figures of residuals: over the image, against θ, against distance.

Each is drawn on axes; ``…_figure`` makes an SVG of it for the page.
"""

from __future__ import annotations

import numpy as np
from matplotlib.axes import Axes

from fisheye_ep_calib.report.data import Rejected, Residuals
from fisheye_ep_calib.report.figures.style import ACCENT, INK, SECOND, SERIES, image_axes, plain_log_ticks, svg
from fisheye_ep_calib.report.magnification import magnification

_CELLS = 16  # along the longer side of the image
_MOST_DRAWN = 4000  # residuals: more hide one another
_LARGEST = 200  # of them in any case
_LEAST_POINTS = 4  # in a cell or a bin whose mean is shown
_BINS = 14


def drawn_residuals(residuals: Residuals) -> str:
    """Which residuals are drawn one by one."""
    count = len(residuals.error)
    return "every residual" if count <= _MOST_DRAWN else f"{_MOST_DRAWN} of {count} residuals, the largest among them"


def _drawn(size: np.ndarray) -> np.ndarray:
    """Which (k,) of residuals of a size (M,) are drawn: all, or a random part with the largest in it."""
    if len(size) <= _MOST_DRAWN:
        return np.arange(len(size))
    rank = np.random.default_rng(0).random(len(size))
    rank[np.argpartition(size, -_LARGEST)[-_LARGEST:]] = -1.0
    drawn: np.ndarray = np.sort(np.argpartition(rank, _MOST_DRAWN)[:_MOST_DRAWN])
    return drawn


def draw_residual_vectors(
    axes: Axes, residuals: Residuals, rejected: tuple[Rejected, ...], size: tuple[int, int]
) -> tuple[float, float]:
    """Residuals as faint vectors, the mean of each cell as a strong one; returns both magnifications."""
    longer = max(size)
    length = np.linalg.norm(residuals.error, axis=-1)
    factor = magnification(length, longer / 40)
    middle, mean = _cell_means(residuals, longer / _CELLS)
    mean_factor = magnification(np.linalg.norm(mean, axis=-1), longer / 22) if len(mean) else 1.0
    starts, errors = (each[_drawn(length)] for each in (residuals.pixels, residuals.error))
    ends = starts + factor * errors
    lines = np.stack([starts, ends, np.full_like(ends, np.nan)], axis=1).reshape(-1, 2)
    axes.plot(*lines.T, color=ACCENT, lw=0.6, alpha=0.8, rasterized=True)
    if len(mean):
        axes.quiver(
            *middle.T,
            *(mean_factor * mean).T,
            angles="xy",
            scale_units="xy",
            scale=1,
            width=0.0045,
            color=SECOND,
            zorder=3,
        )
    if rejected:
        axes.plot(*np.array([point.pixel for point in rejected]).T, "x", ms=4, mew=1.1, color=SERIES[4])
    image_axes(axes, size)
    return factor, mean_factor


def residual_vectors_figure(
    residuals: Residuals, rejected: tuple[Rejected, ...], size: tuple[int, int], identity: str
) -> tuple[str, float, float]:
    """The SVG, and both magnifications."""
    factors: list[tuple[float, float]] = []
    drawn = svg(
        lambda figure: factors.append(draw_residual_vectors(figure.add_subplot(), residuals, rejected, size)),
        identity,
        (4.6, 0.6 + 4.0 * size[1] / size[0]),
    )
    return drawn, *factors[0]


def _cell_means(residuals: Residuals, side: float) -> tuple[np.ndarray, np.ndarray]:
    """Middles (c, 2) of square cells with enough points, and their mean residuals (c, 2), px."""
    cell = (residuals.pixels // side).astype(int)
    cells, index, count = np.unique(cell, axis=0, return_inverse=True, return_counts=True)
    index = index.reshape(-1)
    mean = np.stack(
        [np.bincount(index, weights=residuals.error[:, axis], minlength=len(cells)) / count for axis in (0, 1)], axis=-1
    )
    enough = count >= _LEAST_POINTS
    return (cells[enough] + 0.5) * side, mean[enough]


def draw_residuals_by_angle(axes: Axes, residuals: Residuals) -> None:
    """Radial and tangential parts against θ: a mean off zero is an error of the model, spread is noise."""
    along = residuals.azimuth
    radial = residuals.error[:, 0] * np.cos(along) + residuals.error[:, 1] * np.sin(along)
    tangential = -residuals.error[:, 0] * np.sin(along) + residuals.error[:, 1] * np.cos(along)
    degrees, shown = np.degrees(residuals.theta), _drawn(np.abs(radial))
    axes.axhline(0, color=INK, lw=0.7)
    axes.plot(degrees[shown], radial[shown], ".", ms=2.2, color=ACCENT, alpha=0.5, mew=0, rasterized=True)
    edges = np.linspace(0, degrees.max() * (1 + 1e-9), _BINS + 1)
    _binned_mean(axes, degrees, radial, edges, SECOND, "mean, radial")
    _binned_mean(axes, degrees, tangential, edges, SERIES[2], "mean, tangential")
    reach = 1.15 * float(np.quantile(np.abs(radial), 0.995))
    axes.set(xlabel="θ, degrees", ylabel="residual, px", xlim=(0, edges[-1]), ylim=(-reach, reach))
    axes.legend(loc="lower left", ncols=2)


def residuals_by_angle_figure(residuals: Residuals, identity: str) -> str:
    return svg(lambda figure: draw_residuals_by_angle(figure.add_subplot(), residuals), identity)


def draw_residuals_by_distance(axes: Axes, residuals: Residuals) -> None:
    """Lengths against distance, with their RMS."""
    length = np.linalg.norm(residuals.error, axis=-1)
    distance = residuals.distance
    shown = _drawn(length)
    axes.plot(distance[shown], length[shown], ".", ms=2.2, color=ACCENT, alpha=0.5, mew=0, rasterized=True)
    wide = distance.max() > 4 * distance.min()
    space = np.geomspace if wide else np.linspace
    edges = space(distance.min() * (1 - 1e-9), distance.max() * (1 + 1e-9) + 1e-12, _BINS + 1)
    middle, square = _bin_means(distance, length**2, edges)
    axes.plot(middle, np.sqrt(square), "o-", ms=3.5, color=SECOND, label="RMS")
    if wide:
        axes.set_xscale("log")
        plain_log_ticks(axes.xaxis, distance)
    axes.set(xlabel="distance, m", ylabel="residual, px", ylim=(0, 1.15 * float(np.quantile(length, 0.995))))
    axes.legend()


def residuals_by_distance_figure(residuals: Residuals, identity: str) -> str:
    return svg(lambda figure: draw_residuals_by_distance(figure.add_subplot(), residuals), identity)


def _binned_mean(axes: Axes, x: np.ndarray, y: np.ndarray, edges: np.ndarray, color: str, label: str) -> None:
    """Mean by bin with its standard error."""
    middle, mean = _bin_means(x, y, edges)
    _, square = _bin_means(x, y**2, edges)
    count = np.histogram(x, edges)[0]
    error = np.sqrt(np.maximum(square - mean**2, 0) / count[count >= _LEAST_POINTS])
    axes.errorbar(middle, mean, error, fmt="o-", ms=3.5, lw=1.4, elinewidth=1, color=color, label=label)


def _bin_means(x: np.ndarray, y: np.ndarray, edges: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Mean x and mean y of the bins with enough points."""
    count = np.histogram(x, edges)[0]
    enough = count >= _LEAST_POINTS
    sums = [np.histogram(x, edges, weights=values)[0][enough] for values in (x, y)]
    return sums[0] / count[enough], sums[1] / count[enough]
