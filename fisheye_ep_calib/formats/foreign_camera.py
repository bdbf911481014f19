"""A camera of another calibrator, as it was read."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any

import numpy as np

from fisheye_ep_calib.camera import FisheyeCamera
from fisheye_ep_calib.errors import InputError
from fisheye_ep_calib.file_values import numbers

PINHOLE_TERMS = (0, 4, 5, 8, 12, 14)  # numbers of coefficients that OpenCV's distortion may have
MOST_PIXELS = 1 << 16  # a side


@dataclass(frozen=True)
class ForeignCamera:
    """name: what the file calls it. model: what the file calls its kind.

    file_from_camera (3, 3): how the camera's frame, whose z is the optical axis, is turned in the file's.
    notes: what the file says that is not used, in words.
    """

    name: str
    camera: FisheyeCamera
    model: str
    file_from_camera: np.ndarray = field(default_factory=lambda: np.eye(3))
    notes: tuple[str, ...] = ()


def fisheye_camera(size: tuple[int, int], matrix: np.ndarray, distortion: list[float]) -> FisheyeCamera:
    """OpenCV's fisheye, ROS's equidistant: k1..k4. matrix (3, 3): with skew at [0, 1]."""
    if len(distortion) != 4:
        raise InputError(f"equidistant takes 4 distortion coefficients, not {len(distortion)}")
    return FisheyeCamera(checked_size(*size), **_grid(matrix), radial=tuple(distortion))


def pinhole_camera(size: tuple[int, int], matrix: np.ndarray, distortion: list[float]) -> FisheyeCamera:
    """OpenCV's pinhole, ROS's plumb_bob and rational_polynomial. distortion: in OpenCV's order, of its lengths."""
    if len(distortion) not in PINHOLE_TERMS:
        told = ", ".join(map(str, PINHOLE_TERMS))
        raise InputError(f"a pinhole takes {told} distortion coefficients, not {len(distortion)}")
    values = [*distortion, *[0.0] * (14 - len(distortion))]
    extras: dict[str, tuple[float, ...]] = {}
    if any(values[:12]):
        extras["brown_conrady"] = tuple(values[:12])
    if any(values[12:]):
        extras["tilt"] = tuple(values[12:])
    return FisheyeCamera(checked_size(*size), **_grid(matrix), radial=(), lens="perspective", extras=extras)


def checked_size(width: int, height: int) -> tuple[int, int]:
    """An image's size that is possible. Raises InputError."""
    if not (isinstance(width, int) and isinstance(height, int)) or isinstance(width, bool):
        raise InputError("the image's width and height must be whole numbers")
    if not (0 < width <= MOST_PIXELS and 0 < height <= MOST_PIXELS):
        raise InputError(f"an image of {width}×{height} pixels is not possible")
    return width, height


def size_of(value: Any, key: str) -> tuple[int, int]:
    """An image's width and height in a list. Raises InputError."""
    sides = numbers(value, key, 2)
    if not all(side.is_integer() for side in sides):
        raise InputError(f"{key}: the image's width and height must be whole numbers")
    return checked_size(int(sides[0]), int(sides[1]))


def _grid(matrix: np.ndarray) -> dict[str, Any]:
    if matrix.shape != (3, 3) or not np.isfinite(matrix).all() or matrix[2, 2] != 1:
        raise InputError("the camera matrix must be 3×3, its last number 1")
    fx, skew, cx, _, fy, cy = matrix[:2].ravel().tolist()
    return {"fx": fx, "fy": fy, "cx": cx, "cy": cy, "skew": skew}
