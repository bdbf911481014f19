"""The bow of a flat target: the general quadric, two curvatures along the board's axes and their twist.

    z = w_x (1 − (x/h_x)²) + w_y (1 − (y/h_y)²) + w_xy (x/h_x)(y/h_y)

with x, y from the middle of the board along its own axes and h its half extents: w_x and w_y are the sags in
metres between the middle and the edges; w_xy lets the principal curvatures lie askew, as they do where a sheet
hangs from one corner. mrcal's warp is the same with w_xy = 0.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

WARP_NAMES = ("w_x", "w_y", "w_xy")


@dataclass(frozen=True)
class BoardFrame:
    """The target's own plane. axes (3, 3): columns x, y, normal in the target frame; middle (3,), metres.

    half_extent (2,): metres. planar: whether all points lie in the plane.
    """

    axes: np.ndarray
    middle: np.ndarray
    half_extent: np.ndarray
    planar: bool

    def warp_shapes(self, points: np.ndarray) -> np.ndarray:
        """∂z/∂(w_x, w_y, w_xy), (3, *S), at points (3, *S) of the target frame."""
        x, y = (
            (np.tensordot(self.axes[:, axis], points, axes=1) - self.axes[:, axis] @ self.middle)
            / self.half_extent[axis]
            for axis in range(2)
        )
        return np.stack([1 - x * x, 1 - y * y, x * y])


def board_middle(object_points: np.ndarray) -> np.ndarray:
    """The middle (3,) of points (n, 3), metres: of the box around them."""
    return 0.5 * (object_points.min(axis=0) + object_points.max(axis=0))


def board_frame(object_points: np.ndarray) -> BoardFrame:
    """The frame of points (n, 3), metres; a board in a plane z = constant keeps its x and y axes."""
    middle = board_middle(object_points)
    extent = np.ptp(object_points, axis=0)
    size = max(float(extent.max()), 1e-12)
    axes = np.eye(3)
    if extent[2] > 1e-9 * size:
        _, _, axes_rows = np.linalg.svd(object_points - object_points.mean(axis=0), full_matrices=True)
        axes = axes_rows.T.copy()
        axes[:, 2] *= np.sign(np.linalg.det(axes))
        middle = object_points.mean(axis=0)
    local = (object_points - middle) @ axes
    half_extent = np.maximum(np.abs(local).max(axis=0), 1e-12)
    planar = bool(half_extent[2] <= 1e-6 * size)
    return BoardFrame(axes, middle, half_extent[:2], planar)
