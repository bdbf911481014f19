"""A first camera and first poses with nothing known: no focal length, no distortion, no pose.

For each of a grid of focal lengths the pixels are turned into unit rays of the equidistant lens r = θ, every
view's pose is found from its rays, and the focal length with the smallest median error wins. Rays, not image
coordinates, carry the homography, so that it holds past 90° from the axis.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from fisheye_ep_calib.calibration.board_warp import BoardFrame
from fisheye_ep_calib.calibration.ray_pose import poses_from_rays
from fisheye_ep_calib.calibration.views import ViewBlock

_THETA_GRID = np.deg2rad(np.geomspace(16.0, 120.0, 14))  # candidate angles of the outermost sighting
_SAMPLE_VIEWS = 10
_SAMPLE_POINTS = 20


@dataclass(frozen=True)
class InitialGuess:
    """focal_length px; centre (2,) px; camera_from_target (V, 4, 4)."""

    focal_length: float
    centre: np.ndarray
    camera_from_target: np.ndarray


def initial_guess(
    blocks: tuple[ViewBlock, ...], board: BoardFrame, image_size, views: int, robust: bool = False
) -> InitialGuess:
    """Choose the focal length and the poses of all V views from the image centre outwards.

    robust: for sightings with gross errors, at some cost in time.
    """
    centre = 0.5 * (np.array(image_size, dtype=float) - 1)
    largest = max(_radius(block, centre)[block.weights > 0].max() for block in blocks)
    focal_lengths = largest / _THETA_GRID
    pixels, points, used = _sample(blocks)
    copies = len(focal_lengths)
    trial_rays = equidistant_rays(pixels[:, None], centre, focal_lengths[:, None, None])
    _, error = _poses_and_errors(
        trial_rays.reshape(3, -1, pixels.shape[-1]),
        np.tile(pixels, (1, copies, 1)),
        np.tile(points, (1, copies, 1)),
        np.tile(used, (copies, 1)),
        board,
        centre,
        np.repeat(focal_lengths, len(used))[:, None],
        solutions=3 if robust else 1,
        robust=robust,
    )
    medians = np.median(error.reshape(copies, *used.shape)[:, used], axis=-1)
    focal = float(focal_lengths[np.argmin(medians)])
    poses = np.tile(np.eye(4), (views, 1, 1))
    for block in blocks:
        rays = equidistant_rays(block.pixels, centre, focal)
        poses[block.views], _ = _poses_and_errors(
            rays, block.pixels, block.object_points, block.weights > 0, board, centre, focal, 4 if robust else 1, robust
        )
    return InitialGuess(focal, centre, poses)


def _sample(blocks: tuple[ViewBlock, ...]):
    """Pixels (2, B, N), points (3, B, N) and used (B, N) of a spread of views and points: enough to choose by."""
    places = [(block, row) for block in blocks for row in range(len(block.views))]
    chosen = [places[i] for i in np.unique(np.linspace(0, len(places) - 1, _SAMPLE_VIEWS).astype(int))]
    pixels, points, used = [], [], []
    for block, row in chosen:
        columns = np.flatnonzero(block.weights[row] > 0)
        columns = columns[np.linspace(0, len(columns) - 1, _SAMPLE_POINTS).astype(int)]
        pixels.append(block.pixels[:, row, columns])
        points.append(block.object_points[:, row, columns])
        used.append(np.diff(columns, prepend=-1) > 0)
    return np.stack(pixels, axis=1), np.stack(points, axis=1), np.stack(used)


def _radius(block: ViewBlock, centre: np.ndarray) -> np.ndarray:
    return np.hypot(block.pixels[0] - centre[0], block.pixels[1] - centre[1])


def equidistant_rays(pixels: np.ndarray, centre: np.ndarray, focal: float | np.ndarray) -> np.ndarray:
    """Unit rays (3, ...) of pixels (2, ...) for r = focal · θ; θ is held below π."""
    x, y = pixels[0] - centre[0], pixels[1] - centre[1]
    radius = np.sqrt(x * x + y * y)
    theta = np.minimum(radius / focal, 3.1)
    scale = np.sin(theta) / np.where(radius > 0, radius, 1.0)
    return np.stack([x * scale, y * scale, np.cos(theta)])


def _poses_and_errors(rays, pixels, object_points, used, board, centre, focal, solutions, robust):
    """Poses (B, 4, 4) and the errors (B, N), px, of their sightings through r = focal · θ."""
    poses = poses_from_rays(rays, object_points, used, board, solutions, robust)
    points = np.einsum("bij,jbn->ibn", poses[:, :3, :3], object_points)
    points += np.moveaxis(poses[:, :3, 3], -1, 0)[..., None]
    rho = np.hypot(points[0], points[1])
    scale = focal * np.arctan2(rho, points[2]) / np.where(rho > 0, rho, 1.0)
    error = np.hypot(points[0] * scale + centre[0] - pixels[0], points[1] * scale + centre[1] - pixels[1])
    return poses, error
