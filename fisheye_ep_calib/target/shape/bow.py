"""The bow of a flat target: the general quadric, two curvatures along the board's axes and their twist.

    z = w_x (1 − (x/h_x)²) + w_y (1 − (y/h_y)²) + w_xy (x/h_x)(y/h_y)

with x, y from the middle of the board along its own axes and h its half extents: w_x and w_y are the sags in
metres between the middle and the edges; w_xy lets the principal curvatures lie askew, as they do where a sheet
hangs from one corner. mrcal's warp is the same with w_xy = 0.
"""

from __future__ import annotations

import numpy as np

from fisheye_ep_calib.arrays import FloatArray
from fisheye_ep_calib.target.shape.frame import BoardFrame

WARP_NAMES = ("w_x", "w_y", "w_xy")


def bow_height(frame: BoardFrame, points: np.ndarray) -> np.ndarray:
    """∂z/∂(w_x, w_y, w_xy), (n, 3), at points (n, 3) of the target frame."""
    x, y = frame.plane_coordinates(points).T
    return np.stack([1 - x * x, 1 - y * y, x * y], axis=-1)


def nearest_bow(frame: BoardFrame, points: np.ndarray, height: np.ndarray) -> np.ndarray:
    """w_x, w_y, w_xy (3,), metres, of the bow that comes nearest to heights (n,) above points (n, 3), tilt aside."""
    columns = np.concatenate([bow_height(frame, points), frame.local(points)[:, :2], np.ones((len(points), 1))], axis=1)
    size = np.maximum(np.abs(columns).max(axis=0), 1e-300)
    bow: FloatArray = (np.linalg.lstsq(columns / size, height, rcond=None)[0] / size)[:3]
    return bow


def bow_slope(frame: BoardFrame, points: np.ndarray) -> np.ndarray:
    """∂²z/∂(x, y)∂(w_x, w_y, w_xy), (n, 2, 3), 1/metre, at points (n, 3) of the target frame."""
    x, y = frame.plane_coordinates(points).T
    zero = np.zeros_like(x)
    along_x = np.stack([-2 * x, zero, y], axis=-1) / frame.half_extent[0]
    along_y = np.stack([zero, -2 * y, x], axis=-1) / frame.half_extent[1]
    return np.stack([along_x, along_y], axis=1)
