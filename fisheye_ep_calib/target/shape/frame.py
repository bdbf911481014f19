"""The plane of a flat target: its own axes, its middle and its extent."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from fisheye_ep_calib.arrays import FloatArray

_NEARLY_FLAT = 0.05  # depth over size: up to it a measured board is one plane to a first guess of its poses


@dataclass(frozen=True)
class BoardFrame:
    """The target's own plane. axes (3, 3): columns x, y, normal in the target frame; middle (3,), metres.

    half_extent (2,): metres. planar: whether the points lie in the plane, but for what a bent board departs from it.
    """

    axes: FloatArray
    middle: FloatArray
    half_extent: FloatArray
    planar: bool

    def local(self, points: FloatArray) -> FloatArray:
        """Points (..., 3) of the target frame about the middle, along the frame's axes, metres."""
        return (points - self.middle) @ self.axes

    def plane_coordinates(self, points: FloatArray) -> FloatArray:
        """x, y (..., 2) of points (..., 3) in units of the half extents: −1 to 1 on the board."""
        return self.local(points)[..., :2] / self.half_extent


def board_middle(object_points: np.ndarray) -> np.ndarray:
    """The middle (3,) of points (n, 3), metres: of the box around them."""
    middle: FloatArray = 0.5 * (object_points.min(axis=0) + object_points.max(axis=0))
    return middle


def board_frame(object_points: np.ndarray) -> BoardFrame:
    """The frame of points (n, 3), metres; a board in a plane z = constant keeps its x and y axes.

    Another board's x axis is the target's, laid into the plane of least squares.
    """
    extent = np.ptp(object_points, axis=0)
    size = max(float(extent.max()), 1e-12)
    axes = np.eye(3)
    if extent[2] > 1e-9 * size:
        axes = _least_squares_axes(object_points)
    local = object_points @ axes
    half_extent = np.maximum(0.5 * np.ptp(local, axis=0), 1e-12)
    planar = bool(half_extent[2] <= 0.5 * _NEARLY_FLAT * size)
    return BoardFrame(axes, axes @ board_middle(local), half_extent[:2], planar)


def _least_squares_axes(points: np.ndarray) -> np.ndarray:
    """Axes (3, 3), columns x, y, normal of the plane of least squares through points (n, 3)."""
    _, _, rows = np.linalg.svd(points - points.mean(axis=0), full_matrices=len(points) < 3)  # n × n otherwise
    normal = rows[2] * np.sign(rows[2][np.argmax(np.abs(rows[2]))])
    along = np.eye(3)[1 if abs(normal[0]) > 0.9 else 0]
    x = along - (along @ normal) * normal
    x /= np.linalg.norm(x)
    return np.stack([x, np.cross(normal, x), normal], axis=-1)
