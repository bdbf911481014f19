"""The board as it is: its height as colour, what its points are off in the plane as arrows."""

from __future__ import annotations

import numpy as np
from matplotlib.axes import Axes

from fisheye_ep_calib.report.figures.residuals import magnification
from fisheye_ep_calib.report.figures.style import INK, svg
from fisheye_ep_calib.target.shape.measured import BoardShape

_HEIGHTS = "RdBu_r"
_LEAST_MM = 1e-3  # of the scale of heights
_AREA = 26000.0  # of all points together, in square points of print


def draw_board(axes: Axes, board: BoardShape) -> float:
    """Draw it in millimetres as one looks at the target file's x and y; returns the arrows' magnification."""
    place = 1e3 * board.frame.local(board.object_points)[:, :2]
    off = 1e3 * board.in_board_axes
    scale = max(float(np.abs(off[:, 2]).max()), _LEAST_MM)
    size = float(np.clip(_AREA / len(place), 8.0, 260.0))
    x, y = place.T
    dots = axes.scatter(x, y, c=off[:, 2], s=size, cmap=_HEIGHTS, vmin=-scale, vmax=scale, linewidths=0)
    factor = magnification(np.hypot(off[:, 0], off[:, 1]), float(np.ptp(place, axis=0).max()) / 12)
    axes.quiver(x, y, *(factor * off[:, :2]).T, angles="xy", scale_units="xy", scale=1, width=0.003, color=INK)
    axes.set(xlabel="x, mm", ylabel="y, mm", aspect="equal")
    axes.invert_yaxis()
    axes.margins(0.08)
    axes.grid(False)
    axes.figure.colorbar(dots, ax=axes, label="height, mm", shrink=0.8)
    return factor


def board_figure(board: BoardShape, identity: str) -> tuple[str, float]:
    """The SVG, and the arrows' magnification."""
    factors: list[float] = []
    extent = np.ptp(board.frame.local(board.object_points)[:, :2], axis=0)
    tall = float(np.clip(extent[1] / max(extent[0], 1e-12), 0.4, 1.3))
    drawn = svg(
        lambda figure: factors.append(draw_board(figure.add_subplot(), board)), identity, (4.6, 0.7 + 3.6 * tall)
    )
    return drawn, factors[0]
