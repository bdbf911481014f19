"""Where a rectified image's pixels look: perspective, cylindrical and equirectangular projections.

Image plane coordinates (x, y) are pixels from the principal point over the focal length. Each projection gives the
point at depth 1 that is seen there; depth is what a depth image of that projection holds: z of a perspective image
(REP 118), the distance from the viewpoint of the others.

A new projection is one class and one line in PROJECTIONS.
"""

from __future__ import annotations

from typing import Protocol

import numpy as np


class Projection(Protocol):
    """largest_fov: rad, horizontal, above which no image exists; usual_fov: rad, taken where none is asked for.

    surface: "plane" or "sphere", what a view usually shows. pinhole: whether CameraInfo's P describes it.
    """

    largest_fov: float
    usual_fov: float
    surface: str
    pinhole: bool

    def half_extent(self, angle: float) -> float:
        """Image plane coordinate of a horizontal angle (rad) from the middle."""
        ...

    def half_height(self, half_width: float, aspect: float) -> float:
        """Usual half height, image plane coordinate. aspect: height over width of the fisheye's image."""
        ...

    def points(self, x: np.ndarray, y: np.ndarray) -> np.ndarray:
        """Points (..., 3) at depth 1; NaN where nothing is seen."""
        ...

    def plane(self, points: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Image plane coordinates x, y (...) of points (..., 3); NaN where they have none."""
        ...


class Perspective:
    """x = X/Z, y = Y/Z: straight lines stay straight."""

    largest_fov = np.radians(170)  # the image of 180° would be infinitely large
    usual_fov = np.radians(100)
    surface = "plane"
    pinhole = True

    def half_extent(self, angle: float) -> float:
        return float(np.tan(angle))

    def half_height(self, half_width: float, aspect: float) -> float:
        return half_width * aspect

    def points(self, x: np.ndarray, y: np.ndarray) -> np.ndarray:
        x, y = np.broadcast_arrays(x, y)
        return np.stack([x, y, np.ones_like(x)], axis=-1)

    def plane(self, points: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        depth = np.where(points[..., 2] > 0, points[..., 2], np.nan)
        return points[..., 0] / depth, points[..., 1] / depth


class Cylindrical:
    """x = λ, y = tan(elevation), λ = atan2(X, Z): vertical lines stay straight, and all around can be seen."""

    largest_fov = usual_fov = 2 * np.pi
    surface = "sphere"
    pinhole = False

    def half_extent(self, angle: float) -> float:
        return angle

    def half_height(self, half_width: float, aspect: float) -> float:
        return 1.0  # tan 45°

    def points(self, x: np.ndarray, y: np.ndarray) -> np.ndarray:
        x, y = np.broadcast_arrays(x, y)
        length = np.sqrt(1 + y * y)
        points = np.stack([np.sin(x), y, np.cos(x)], axis=-1) / length[..., None]
        return np.where((np.abs(x) <= np.pi)[..., None], points, np.nan)

    def plane(self, points: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        across = np.hypot(points[..., 0], points[..., 2])
        return np.arctan2(points[..., 0], points[..., 2]), points[..., 1] / np.where(across > 0, across, np.nan)


class Equirectangular:
    """x = λ = atan2(X, Z), y = elevation: every direction has its place."""

    largest_fov = usual_fov = 2 * np.pi
    surface = "sphere"
    pinhole = False

    def half_extent(self, angle: float) -> float:
        return angle

    def half_height(self, half_width: float, aspect: float) -> float:
        return float(np.radians(60))

    def points(self, x: np.ndarray, y: np.ndarray) -> np.ndarray:
        x, y = np.broadcast_arrays(x, y)
        points = np.stack([np.sin(x) * np.cos(y), np.sin(y), np.cos(x) * np.cos(y)], axis=-1)
        return np.where(((np.abs(x) <= np.pi) & (np.abs(y) <= np.pi / 2))[..., None], points, np.nan)

    def plane(self, points: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        across = np.hypot(points[..., 0], points[..., 2])
        return np.arctan2(points[..., 0], points[..., 2]), np.arctan2(points[..., 1], across)


PROJECTIONS: dict[str, Projection] = {
    "perspective": Perspective(),
    "cylindrical": Cylindrical(),
    "equirectangular": Equirectangular(),
}
