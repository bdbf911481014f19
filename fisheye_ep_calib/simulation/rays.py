"""The ray of every pixel of a camera, computed once, and where those rays meet a target's plane."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from fisheye_ep_calib.simulation.patterns import Pattern
from fisheye_ep_calib.simulation.scene_camera import SceneCamera

Window = tuple[int, int, int, int]  # first column, first row, past the last column, past the last row

_ROWS_AT_ONCE = 128


@dataclass(frozen=True)
class PixelRays:
    """One ray a pixel of the image and of a border of one pixel, so that all of the image has neighbours.

    origins, directions (h + 2, w + 2, 3) float32: metres and unit vectors, camera frame; NaN where the camera
    sees nothing. A float32 direction errs by about 5e-5 px.
    """

    origins: np.ndarray
    directions: np.ndarray

    @staticmethod
    def of(camera: SceneCamera) -> PixelRays:
        """The rays of a camera."""
        width, height = camera.image_size
        shape = (height + 2, width + 2, 3)
        origins, directions = np.empty(shape, np.float32), np.empty(shape, np.float32)
        u = np.arange(-1, width + 1, dtype=float)
        for first in range(0, height + 2, _ROWS_AT_ONCE):
            rows = slice(first, min(first + _ROWS_AT_ONCE, height + 2))
            v = np.arange(rows.start, rows.stop, dtype=float) - 1
            start, direction, valid = camera.unproject(np.stack(np.meshgrid(u, v), axis=-1))
            origins[rows] = np.where(valid[..., None], start, np.nan)
            directions[rows] = np.where(valid[..., None], direction, np.nan)
        return PixelRays(origins, directions)


_cache: list[tuple[SceneCamera, PixelRays]] = []
_CACHED_CAMERAS = 2


def pixel_rays(camera: SceneCamera) -> PixelRays:
    """The rays of a camera, kept for the next image of the same camera."""
    for cached, rays in _cache:
        if cached == camera:
            return rays
    del _cache[: max(0, len(_cache) - _CACHED_CAMERAS + 1)]
    _cache.append((camera, PixelRays.of(camera)))
    return _cache[-1][1]


def plane_points(
    rays: PixelRays, camera_from_target: np.ndarray, window: Window, faces: int
) -> tuple[np.ndarray, np.ndarray]:
    """Where the rays of a window of pixels meet the target's plane z = 0: x and y (h + 2, w + 2), metres.

    The window is given in pixels; the result carries the border of one pixel. With a ray o + t d in the
    camera frame, o' = Rᵀ(o − T) and d' = Rᵀd in the target frame, x = o'x − d'x o'z / d'z. NaN where the
    ray does not meet the side that faces +z (faces = 1) or −z (faces = −1).
    """
    left, top, right, bottom = window
    area = (slice(top, bottom + 2), slice(left, right + 2))
    rotation = camera_from_target[:3, :3].astype(np.float32)
    origin = (rays.origins[area] - camera_from_target[:3, 3].astype(np.float32)) @ rotation
    direction = rays.directions[area] @ rotation
    with np.errstate(divide="ignore", invalid="ignore"):
        distance = -origin[..., 2] / direction[..., 2]
        in_front = (distance > 0) & (origin[..., 2] * faces > 0)
        distance[~in_front] = np.nan
    return origin[..., 0] + distance * direction[..., 0], origin[..., 1] + distance * direction[..., 1]


def board_window(camera: SceneCamera, pattern: Pattern, camera_from_target: np.ndarray) -> Window:
    """The pixels in which a board can show: around the projection of a grid of its points.

    The whole image is taken where part of the board lies outside the field of view, because then the
    projected points do not bound it.
    """
    width, height = camera.image_size
    x, y = np.meshgrid(*np.linspace(pattern.low, pattern.high, 25).T)
    points = np.stack([x, y, np.zeros_like(x)], axis=-1)
    pixels, valid = camera.project(points @ camera_from_target[:3, :3].T + camera_from_target[:3, 3])
    if not valid.any():
        return 0, 0, 0, 0
    if not valid.all():
        return 0, 0, width, height
    step = np.abs(np.diff(pixels, axis=0)).max() + np.abs(np.diff(pixels, axis=1)).max()
    low = np.floor(pixels.min(axis=(0, 1)) - step - 2).astype(int)
    high = np.ceil(pixels.max(axis=(0, 1)) + step + 3).astype(int)
    left, top = np.clip(low, 0, (width, height))
    right, bottom = np.clip(high, 0, (width, height))
    return int(left), int(top), int(right), int(bottom)
