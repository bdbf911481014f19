"""Ellipses as matrices, x' shape⁻¹ x = 1, and where pixels lie about them."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from fisheye_ep_calib.target.pixel_patches import PixelPatches


def minor_axis(shape: np.ndarray) -> np.ndarray:
    """Minor semi-axes (k,) of ellipse matrices (k, 2, 2)."""
    xx, xy, yy = shape[:, 0, 0], shape[:, 0, 1], shape[:, 1, 1]
    result: np.ndarray = np.sqrt(np.maximum((xx + yy) / 2 - np.sqrt((xx - yy) ** 2 / 4 + xy**2), 0))
    return result


def major_axis(shape: np.ndarray) -> np.ndarray:
    """Major semi-axes (k,) of ellipse matrices (k, 2, 2)."""
    xx, xy, yy = shape[:, 0, 0], shape[:, 0, 1], shape[:, 1, 1]
    result: np.ndarray = np.sqrt(np.maximum((xx + yy) / 2 + np.sqrt((xx - yy) ** 2 / 4 + xy**2), 0))
    return result


def half_box(shape: np.ndarray) -> np.ndarray:
    """Half width and height (k, 2) of each ellipse's bounding box."""
    result: np.ndarray = np.sqrt(np.maximum(np.diagonal(shape, axis1=1, axis2=2), 0))
    return result


@dataclass(frozen=True)
class EllipsePosition:
    """Where the pixels of patches lie about their ellipses.

    radius (p,): s = √(x' shape⁻¹ x), 1 on the edge. distance (p,): outwards from the edge, pixels, (s − 1) /
    |∇s|. gradient_x, gradient_y (p,): shape⁻¹ x.
    """

    radius: np.ndarray
    distance: np.ndarray
    gradient_x: np.ndarray
    gradient_y: np.ndarray

    @staticmethod
    def of(patches: PixelPatches, shape: np.ndarray) -> EllipsePosition:
        inverse = np.linalg.inv(shape).astype(np.float32)
        xx, xy, yy = (patches.spread(inverse[:, i, j]) for i, j in ((0, 0), (0, 1), (1, 1)))
        gradient_x, gradient_y = xx * patches.x + xy * patches.y, xy * patches.x + yy * patches.y
        radius = np.sqrt(patches.x * gradient_x + patches.y * gradient_y)
        slope = np.sqrt(gradient_x**2 + gradient_y**2) / np.maximum(radius, 1e-6)
        return EllipsePosition(radius, (radius - 1) / np.maximum(slope, 1e-6), gradient_x, gradient_y)
