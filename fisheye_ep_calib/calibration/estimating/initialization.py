"""A first camera and first poses with nothing known: no focal length, no distortion, no pose.

For each of a grid of focal lengths the pixels are turned into unit rays of the equidistant lens r = θ, every
view's pose is found from its rays, and the focal length with the smallest median error wins. Rays, not image
coordinates, carry the homography, so that it holds past 90° from the axis.
"""

from __future__ import annotations

from dataclasses import dataclass
from itertools import product

import numpy as np

from fisheye_ep_calib.arrays import FloatArray
from fisheye_ep_calib.calibration.estimating.ray_pose import poses_from_rays
from fisheye_ep_calib.calibration.estimating.views import ViewBlock
from fisheye_ep_calib.target.shape.frame import BoardFrame

_THETA_GRID = np.deg2rad(np.geomspace(16.0, 120.0, 14))  # candidate angles of the outermost sighting
_ASPECTS = (0.5, 0.7, 1.0, 1.4, 2.0)  # fy / fx
_OFFSETS = (-0.2, 0.0, 0.2)  # of the centre, in image widths and heights
_SAMPLE_VIEWS = 10
_SAMPLE_POINTS = 20


@dataclass(frozen=True)
class InitialGuess:
    """focal_lengths (2,) px, fx and fy; centre (2,) px; camera_from_target (V, 4, 4)."""

    focal_lengths: np.ndarray
    centre: np.ndarray
    camera_from_target: np.ndarray


def initial_guess(
    blocks: tuple[ViewBlock, ...],
    board: BoardFrame,
    image_size: tuple[int, int],
    views: int,
    robust: bool = False,
    wide: bool = False,
) -> InitialGuess:
    """Choose the focal lengths and the poses of all V views.

    robust: for sightings with gross errors, at some cost in time. wide: also try pixels that are not square and
    centres away from the image's, 45 times the choice.
    """
    focal_lengths, centres = _candidates(blocks, image_size, wide)
    pixels, points, used = _sample(blocks)
    copies = focal_lengths.shape[1]
    each_view = (slice(None), np.repeat(np.arange(copies), len(used)), None)
    _, error = _poses_and_errors(
        np.tile(pixels, (1, copies, 1)),
        np.tile(points, (1, copies, 1)),
        np.tile(used, (copies, 1)),
        board,
        centres[each_view],
        focal_lengths[each_view],
        solutions=3 if robust else 1,
        robust=robust and not wide,
    )
    best = np.argmin(np.median(error.reshape(copies, *used.shape)[:, used], axis=-1))
    focal, centre = focal_lengths[:, best], centres[:, best]
    poses = np.tile(np.eye(4), (views, 1, 1))
    for block in blocks:
        poses[block.views], _ = _poses_and_errors(
            block.pixels,
            block.object_points,
            block.weights > 0,
            board,
            centre[:, None, None],
            focal[:, None, None],
            solutions=4 if robust else 1,
            robust=robust,
        )
    return InitialGuess(focal, centre, poses)


def _candidates(
    blocks: tuple[ViewBlock, ...], image_size: tuple[int, int], wide: bool
) -> tuple[np.ndarray, np.ndarray]:
    """Focal lengths (2, K) px and centres (2, K) px to try."""
    size = np.array(image_size, dtype=float)
    focal_lengths, centres = [], []
    for aspect, *offset in product(_ASPECTS, _OFFSETS, _OFFSETS) if wide else [(1.0, 0.0, 0.0)]:
        stretch, centre = np.array([1.0, aspect]), 0.5 * (size - 1) + offset * size
        radius = max(_radius(block.pixels, centre[:, None, None], stretch)[block.weights > 0].max() for block in blocks)
        focal_lengths.append(radius / _THETA_GRID * stretch[:, None])
        centres.append(np.tile(centre[:, None], len(_THETA_GRID)))
    return np.concatenate(focal_lengths, axis=1), np.concatenate(centres, axis=1)


def _sample(blocks: tuple[ViewBlock, ...]) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Pixels (2, B, N), points (3, B, N) and used (B, N) of a spread of views and points: enough to choose by."""
    places = [(block, row) for block in blocks for row in range(len(block.views))]
    chosen = [places[i] for i in np.unique(np.linspace(0, len(places) - 1, _SAMPLE_VIEWS).astype(int))]
    pixels, points, used = [], [], []
    for block, row in chosen:
        columns = np.flatnonzero(block.weights[row] > 0)
        columns = columns[np.arange(_SAMPLE_POINTS) * (len(columns) - 1) // (_SAMPLE_POINTS - 1)]
        pixels.append(block.pixels[:, row, columns])
        points.append(block.object_points[:, row, columns])
        used.append(np.concatenate([[True], columns[1:] > columns[:-1]]))
    return np.stack(pixels, axis=1), np.stack(points, axis=1), np.stack(used)


def _radius(pixels: np.ndarray, centre: np.ndarray, scale: np.ndarray) -> np.ndarray:
    """Distances of pixels (2, ...) from the centre, in multiples of scale (2,)."""
    radius: FloatArray = np.hypot((pixels[0] - centre[0]) / scale[0], (pixels[1] - centre[1]) / scale[1])
    return radius


def equidistant_rays(pixels: np.ndarray, centre: np.ndarray, focal_lengths: np.ndarray) -> np.ndarray:
    """Unit rays (3, ...) of pixels (2, ...) for θ = |(u − cx) / fx, (v − cy) / fy|, held below π."""
    x, y = (pixels - centre) / focal_lengths
    radius = np.hypot(x, y)
    theta = np.minimum(radius, 3.1)
    scale = np.sin(theta) / np.where(radius > 0, radius, 1.0)
    return np.stack([x * scale, y * scale, np.cos(theta)])


def _poses_and_errors(
    pixels: np.ndarray,
    object_points: np.ndarray,
    used: np.ndarray,
    board: BoardFrame,
    centre: np.ndarray,
    focal_lengths: np.ndarray,
    solutions: int,
    robust: bool,
) -> tuple[np.ndarray, np.ndarray]:
    """Poses (B, 4, 4) and the errors (B, N), px, of their sightings through the equidistant lens."""
    rays = equidistant_rays(pixels, centre, focal_lengths)
    poses = poses_from_rays(rays, object_points, used, board, solutions, robust)
    points = np.einsum("bij,jbn->ibn", poses[:, :3, :3], object_points)
    points += np.moveaxis(poses[:, :3, 3], -1, 0)[..., None]
    rho = np.hypot(points[0], points[1])
    scale = np.arctan2(rho, points[2]) / np.where(rho > 0, rho, 1.0)
    error = points[:2] * scale * focal_lengths + centre - pixels
    return poses, np.hypot(error[0], error[1])
