"""Figure of the target: by how much its points depart from its file. Drawn on axes; ``…_figure`` makes an SVG of it."""

from __future__ import annotations

import numpy as np

from fisheye_ep_calib.report.drawing.colours import Colouring
from fisheye_ep_calib.report.drawing.frame import INK
from fisheye_ep_calib.report.figures.residuals import magnification
from fisheye_ep_calib.report.figures.style import SERIES, AnyAxes, svg
from fisheye_ep_calib.target.shape.measured import BoardShape

HEIGHT_MAP = "RdYlBu_r"
_LEAST_HEIGHT_MM = 1e-3  # what the colours span at least


def draw_board(axes: AnyAxes, board: BoardShape) -> float:
    """Heights as colours, in-plane deviations as arrows, both mm; returns by how much the arrows are enlarged.

    x and y are the board's own axes, y down as on most prints; a height is along the normal, x × y.
    """
    place = 1e3 * board.frame.local(board.object_points)[:, :2]
    moved = 1e3 * board.in_board_axes
    height = moved[:, 2]
    reach = max(float(np.abs(height).max()), _LEAST_HEIGHT_MM)
    colouring = Colouring(HEIGHT_MAP, -reach, reach)
    size = max(float(np.ptp(place, axis=0).max()), 1e-9)
    if board.frame.planar and len(place) > 3 and np.ptp(place, axis=0).min() > 1e-3 * size:
        axes.tripcolor(place[:, 0], place[:, 1], height, colouring)
    axes.scatter(place[:, 0], place[:, 1], height, 14, INK, colouring)
    factor = magnification(np.linalg.norm(moved[:, :2], axis=1), size / 18)
    axes.quiver(*place.T, *(factor * moved[:, :2]).T, width=0.005, color=SERIES[3])
    axes.color_bar(colouring, "height, mm", lambda value: f"{value:.2g}".replace("-", "−"))
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
    drawn = svg(lambda axes: factors.append(draw_board(axes, board)), identity, (4.6, height))
    return drawn, factors[0]
