"""Figure of the target: by how much its points depart from its file. Drawn on axes; ``…_figure`` makes an SVG of it."""

from __future__ import annotations

from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.ticker import FuncFormatter

from fisheye_ep_calib.report.figures.style import BAR, BESIDE_A_BAR, INK, SERIES, svg
from fisheye_ep_calib.report.magnification import magnification
from fisheye_ep_calib.target.shape.measured import BoardShape

HEIGHT_MAP = "RdYlBu_r"
_LEAST_HEIGHT_MM = 1e-3  # what the colours span at least


def draw_board(axes: Axes, board: BoardShape) -> float:
    """Heights as colours, in-plane deviations as arrows, both mm; returns by how much the arrows are enlarged.

    x and y are the board's own axes, y down as on most prints; a height is along the normal, x × y.
    """
    place = 1e3 * board.frame.local(board.object_points)[:, :2]
    moved = 1e3 * board.in_board_axes
    height = moved[:, 2]
    reach = max(float(np.abs(height).max()), _LEAST_HEIGHT_MM)
    colours: dict[str, Any] = {"cmap": HEIGHT_MAP, "vmin": -reach, "vmax": reach}
    size = max(float(np.ptp(place, axis=0).max()), 1e-9)
    if board.frame.planar and len(place) > 3 and np.ptp(place, axis=0).min() > 1e-3 * size:
        axes.tripcolor(place[:, 0], place[:, 1], height, shading="gouraud", rasterized=True, **colours)
    points = axes.scatter(
        place[:, 0], place[:, 1], c=height, s=14, edgecolors=INK, linewidths=0.4, zorder=2, rasterized=True, **colours
    )
    factor = magnification(np.linalg.norm(moved[:, :2], axis=1), size / 18)
    axes.quiver(
        *place.T,
        *(factor * moved[:, :2]).T,
        angles="xy",
        scale_units="xy",
        scale=1,
        width=0.005,
        color=SERIES[3],
        zorder=2.5,
        rasterized=True,
    )
    bar = axes.figure.colorbar(points, ax=axes, **BAR)
    bar.set_label("height, mm")
    bar.outline.set_visible(False)
    bar.ax.yaxis.set_major_formatter(FuncFormatter(lambda value, _: f"{value:.2g}".replace("-", "−")))
    margin = 0.08 * size
    axes.set(
        xlabel="x on the board, mm",
        ylabel="y on the board, mm",
        aspect="equal",
        xlim=(place[:, 0].min() - margin, place[:, 0].max() + margin),
        ylim=(place[:, 1].max() + margin, place[:, 1].min() - margin),
    )
    return factor


def board_figure(board: BoardShape, identity: str) -> tuple[str, float]:
    """The SVG, and by how much its arrows are enlarged."""
    factors: list[float] = []
    extent = np.ptp(board.frame.local(board.object_points)[:, :2], axis=0)
    height = 0.7 + 3.3 * float(np.clip(extent[1] / max(extent[0], 1e-12), 0.4, 1.3))
    drawn = svg(
        lambda figure: factors.append(draw_board(figure.add_subplot(), board)), identity, (4.6, height), BESIDE_A_BAR
    )
    return drawn, factors[0]
