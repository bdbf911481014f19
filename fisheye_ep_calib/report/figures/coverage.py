"""Figures of what was recorded: coverage by angle, azimuth and distance, and what is left uncertain.

Each is drawn on axes; ``…_figure`` makes an SVG of it for the page.
"""

from __future__ import annotations

from typing import cast

import numpy as np
from matplotlib.axes import Axes
from matplotlib.cm import ScalarMappable
from matplotlib.colors import ListedColormap, LogNorm
from matplotlib.projections.polar import PolarAxes
from matplotlib.ticker import FuncFormatter, MaxNLocator

from fisheye_ep_calib.report.data import Coverage, Residuals, UncertaintyMap
from fisheye_ep_calib.report.figures.style import (
    BAR,
    BESIDE_A_BAR,
    FAINT,
    MAP,
    PAPER,
    SERIES,
    Margins,
    image_axes,
    plain_log_ticks,
    svg,
)

_BINS = (24, 20)
_LEVELS = 8
_ROUND = 15  # parts of a wide cell, whose sides would be straight


def draw_coverage(axes: PolarAxes, coverage: Coverage) -> None:
    """Sightings by θ (outward) and azimuth (as in the image, y down); red cells the image shows and nobody filled."""
    azimuth, radius = _edges(coverage.counts, coverage.ring_degrees)
    last = radius[-1]
    axes.set_theta_direction(-1)
    axes.grid(False)
    counts = np.ma.masked_equal(coverage.counts, 0)
    mesh = axes.pcolormesh(azimuth, radius, counts, cmap=MAP, norm=_count_norm(counts), rasterized=True)
    missing = np.ma.masked_equal(np.repeat(coverage.missing.astype(float), _ROUND, axis=1), 0)
    if missing.count():
        edges = _edges(coverage.missing, coverage.missing_ring_degrees, _ROUND)
        axes.pcolormesh(*edges, missing, cmap=_one_color(SERIES[4]), vmin=0, vmax=1, rasterized=True)
        axes.set_rmax(last)
    axes.grid(True, color=FAINT, lw=0.5)
    axes.spines["polar"].set_color(FAINT)
    step = 30 if last > 45 else 15
    ticks = np.arange(step, last + 1e-9, step)
    axes.set_rticks(ticks, [])
    for tick in ticks:
        box = {"boxstyle": "round,pad=0.15", "facecolor": PAPER, "alpha": 0.75, "edgecolor": "none"}
        axes.text(np.radians(30), tick, f"{tick:.0f}°", ha="center", va="center", fontsize=8.5, bbox=box)
    axes.set_xticks(np.radians([0, 90, 180, 270]), ["right", "below", "left", "above"])
    _count_bar(mesh, axes, pad=0.14)


def coverage_figure(coverage: Coverage, identity: str) -> str:
    return svg(
        lambda figure: draw_coverage(cast(PolarAxes, figure.add_subplot(projection="polar")), coverage),
        identity,
        (4.6, 3.6),
        Margins(0.5, 0.62, 0.3, 0.3),
    )


def draw_distances(axes: Axes, residuals: Residuals) -> None:
    """Sightings by θ and distance."""
    degrees, distance = np.degrees(residuals.theta), residuals.distance
    wide = distance.max() > 4 * distance.min()
    low, high = distance.min() * 0.98, distance.max() * 1.02
    rows = (np.geomspace if wide else np.linspace)(low, high, _BINS[1] + 1)
    columns = np.linspace(0, degrees.max() * (1 + 1e-9), _BINS[0] + 1)
    counts = np.histogram2d(degrees, distance, (columns, rows))[0].T
    counts = np.ma.masked_equal(counts, 0)
    mesh = axes.pcolormesh(columns, rows, counts, cmap=MAP, norm=_count_norm(counts), rasterized=True)
    if wide:
        axes.set_yscale("log")
        plain_log_ticks(axes.yaxis, distance)
    axes.set(xlabel="θ, degrees", ylabel="distance, m", xlim=(0, columns[-1]), ylim=(low, high))
    _count_bar(mesh, axes)


def distance_figure(residuals: Residuals, identity: str) -> str:
    return svg(lambda figure: draw_distances(figure.add_subplot(), residuals), identity, margins=BESIDE_A_BAR)


def draw_uncertainty(axes: Axes, uncertainty: UncertaintyMap, size: tuple[int, int]) -> None:
    """1σ in px over the image, for points at one distance."""
    inside = ((uncertainty.pixels >= -0.5) & (uncertainty.pixels <= np.array(size) - 0.5)).all(axis=-1)
    sigma = np.ma.masked_invalid(uncertainty.sigma_px)
    highest = float(np.quantile(sigma[inside].compressed(), 0.98)) if sigma[inside].count() else 1.0
    levels = MaxNLocator(_LEVELS).tick_values(0, max(highest, 1e-6))
    drawn = axes.contourf(
        uncertainty.pixels[..., 0], uncertainty.pixels[..., 1], sigma, levels=levels, cmap=MAP, extend="max"
    )
    bar = axes.figure.colorbar(drawn, ax=axes, **BAR)
    bar.set_label("1σ, px per axis")
    bar.outline.set_visible(False)
    bar.ax.yaxis.set_major_formatter(FuncFormatter(lambda value, _: f"{value:.2g}"))
    image_axes(axes, size)


def uncertainty_figure(uncertainty: UncertaintyMap, size: tuple[int, int], identity: str) -> str:
    return svg(
        lambda figure: draw_uncertainty(figure.add_subplot(), uncertainty, size),
        identity,
        (4.6, 0.6 + 3.4 * size[1] / size[0]),
        BESIDE_A_BAR,
    )


def _edges(cells: np.ndarray, ring_degrees: float, parts: int = 1) -> tuple[np.ndarray, np.ndarray]:
    """Of cells (rings, sectors): azimuths (parts · sectors + 1,), rad, and radii (rings + 1,), degrees."""
    rings, sectors = cells.shape
    half = np.pi / sectors
    return np.linspace(-half, 2 * np.pi - half, parts * sectors + 1), ring_degrees * np.arange(rings + 1)


def _count_norm(counts: np.ma.MaskedArray) -> LogNorm:
    return LogNorm(1, max(float(counts.max()), 2.0))


def _count_bar(mesh: ScalarMappable, axes: Axes, pad: float = BAR["pad"]) -> None:
    bar = axes.figure.colorbar(mesh, ax=axes, **(BAR | {"pad": pad}))
    bar.set_label("points")
    bar.outline.set_visible(False)
    bar.ax.yaxis.set_major_formatter(FuncFormatter(lambda value, _: f"{value:g}"))
    bar.minorticks_off()


def _one_color(color: str) -> ListedColormap:
    return ListedColormap([color])
