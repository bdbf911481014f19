"""Figures of what was recorded: coverage by angle, azimuth and distance, and what is left uncertain.

Each is drawn on axes; ``…_figure`` makes an SVG of it for the page.
"""

from __future__ import annotations

import numpy as np

from fisheye_ep_calib.report.data import Coverage, Residuals, UncertaintyMap
from fisheye_ep_calib.report.drawing.colours import Colouring
from fisheye_ep_calib.report.drawing.frame import FAINT, PAPER
from fisheye_ep_calib.report.drawing.scales import linear_ticks
from fisheye_ep_calib.report.figures.style import MAP, SERIES, AnyAxes, plain_log_ticks, svg

_BINS = (24, 20)
_LEVELS = 8
_CIRCLE = np.linspace(0, 2 * np.pi, 181)
_SIDES = {"right": 0, "below": 90, "left": 180, "above": 270}  # degrees from the right, clockwise


def draw_coverage(axes: AnyAxes, coverage: Coverage) -> None:
    """Sightings by θ (outward) and azimuth (as in the image, y down); red cells the image shows and nobody filled.

    axes: polar.
    """
    azimuth, radius = _edges(coverage.counts, coverage.ring_degrees)
    last = float(radius[-1])
    axes.set(ylim=(0, last))
    colouring = _of_counts(coverage.counts)
    axes.pcolormesh(azimuth, radius, _or_nan(coverage.counts), colouring)
    if coverage.missing.any():
        edges = _edges(coverage.missing, coverage.missing_ring_degrees)
        axes.pcolormesh(*edges, _or_nan(coverage.missing), Colouring(SERIES[4], 0, 1))
        axes.set(ylim=(0, last))
    step = 30 if last > 45 else 15
    ticks = np.arange(step, last + 1e-9, step)
    for radius_deg in (*ticks, last):
        axes.plot(_CIRCLE, np.full(len(_CIRCLE), radius_deg), color=FAINT if axes.on_page else "0.8", lw=0.5)
    for side, degrees in _SIDES.items():
        axes.plot(np.radians([degrees, degrees]), [0, last], color=FAINT if axes.on_page else "0.8", lw=0.5)
        axes.text(np.radians(degrees), 1.1 * last, side)
    for tick in ticks:
        axes.text(np.radians(30), tick, f"{tick:.0f}°", 8.5, PAPER)
    axes.color_bar(colouring, "points", _count_text)


def coverage_figure(coverage: Coverage, identity: str) -> str:
    return svg(lambda axes: draw_coverage(axes, coverage), identity, (4.6, 3.6), polar=True)


def draw_distances(axes: AnyAxes, residuals: Residuals) -> None:
    """Sightings by θ and distance."""
    degrees, distance = np.degrees(residuals.theta), residuals.distance
    wide = distance.max() > 4 * distance.min()
    low, high = distance.min() * 0.98, distance.max() * 1.02
    rows = (np.geomspace if wide else np.linspace)(low, high, _BINS[1] + 1)
    columns = np.linspace(0, degrees.max() * (1 + 1e-9), _BINS[0] + 1)
    counts = np.histogram2d(degrees, distance, (columns, rows))[0].T
    colouring = _of_counts(counts)
    axes.pcolormesh(columns, rows, _or_nan(counts), colouring)
    if wide:
        axes.log_ticks("y", plain_log_ticks(distance))
    axes.set(xlabel="θ, degrees", ylabel="distance, m", xlim=(0, columns[-1]), ylim=(low, high))
    axes.color_bar(colouring, "points", _count_text)


def distance_figure(residuals: Residuals, identity: str) -> str:
    return svg(lambda axes: draw_distances(axes, residuals), identity)


def draw_uncertainty(axes: AnyAxes, uncertainty: UncertaintyMap, size: tuple[int, int]) -> None:
    """1σ in px over the image, for points at one distance."""
    inside = ((uncertainty.pixels >= -0.5) & (uncertainty.pixels <= np.array(size) - 0.5)).all(axis=-1)
    known = np.isfinite(uncertainty.sigma_px)
    shown = uncertainty.sigma_px[inside & known]
    highest = float(np.quantile(shown, 0.98)) if len(shown) else 1.0
    levels = linear_ticks(0, max(highest, 1e-6), _LEVELS)
    levels = np.append(levels, levels[-1] + levels[1])
    colouring = Colouring(MAP, 0.0, float(levels[-1]), levels=tuple(levels.tolist()))
    field = np.where(known, uncertainty.sigma_px, np.nan)
    axes.contourf(uncertainty.pixels[..., 0], uncertainty.pixels[..., 1], field, colouring)
    axes.color_bar(colouring, "1σ, px per axis", lambda value: f"{value:.2g}")
    axes.over_image(size)


def uncertainty_figure(uncertainty: UncertaintyMap, size: tuple[int, int], identity: str) -> str:
    return svg(
        lambda axes: draw_uncertainty(axes, uncertainty, size),
        identity,
        (4.6, 0.6 + 3.4 * size[1] / size[0]),
    )


def _edges(cells: np.ndarray, ring_degrees: float) -> tuple[np.ndarray, np.ndarray]:
    """Of cells (rings, sectors): azimuths (sectors + 1,), rad, and radii (rings + 1,), degrees."""
    rings, sectors = cells.shape
    half = np.pi / sectors
    return np.linspace(-half, 2 * np.pi - half, sectors + 1), ring_degrees * np.arange(rings + 1)


def _or_nan(counts: np.ndarray) -> np.ndarray:
    return np.where(counts > 0, counts, np.nan).astype(float)


def _of_counts(counts: np.ndarray) -> Colouring:
    return Colouring(MAP, 1.0, max(float(counts.max()), 2.0), logarithmic=True)


def _count_text(value: float) -> str:
    return f"{value:g}"
