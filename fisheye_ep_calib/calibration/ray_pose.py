"""Poses from rays: where a target of known shape is, given the unit ray to each of its points.

Planar views: a homography from rays. With b the unit ray and X = (x, y, 1) on the board, b × (H X) = 0; the sum
over a view of |(I − b bᵀ) H X|² is a quadratic form in H whose smallest eigenvector is the answer
(Hartley and Zisserman, Multiple View Geometry, 4.1, on rays instead of image points). Other views: the same with
X = (x, y, z, 1) and the 3×4 matrix (R | t).
"""

import numpy as np

from fisheye_ep_calib.calibration.board_warp import BoardFrame
from fisheye_ep_calib.calibration.rotation import nearest_rotation



def poses_from_rays(
    rays: np.ndarray, object_points: np.ndarray, used: np.ndarray, board: BoardFrame, solutions: int = 4
) -> np.ndarray:
    """Poses camera_from_target (B, 4, 4).

    rays (3, B, N): unit, camera frame. object_points (3, B, N): metres, target frame. used (B, N): bool.
    solutions: how often to solve; each time sightings far off the last solution weigh less.
    """
    if board.planar:
        return _planar_poses(rays, object_points, used, board.axes, board.middle, solutions)
    poses = np.tile(np.eye(4), (used.shape[0], 1, 1))
    for view in range(used.shape[0]):
        points = object_points[:, view][:, used[view]].T
        middle = points.mean(axis=0)
        _, extent, rows = np.linalg.svd(points - middle, full_matrices=True)
        rows[2] *= np.sign(np.linalg.det(rows))
        selected = (slice(None), slice(view, view + 1))
        flat = extent[2] < 1e-3 * extent[0]
        solve = _planar_poses if flat else _spatial_poses
        poses[view] = solve(
            rays[selected], object_points[selected], used[view : view + 1], rows.T, middle, solutions
        )[0]
    return poses


def _normalised(object_points, used, axes, middle):
    """Board coordinates (3, B, N), centred and scaled a view, with offset (3, B) and scale (B,)."""
    local = np.tensordot(axes.T, object_points - middle[:, None, None], axes=1)
    count = np.maximum(used.sum(axis=-1), 1)
    offset = (local * used).sum(axis=-1) / count
    local = local - offset[..., None]
    scale = np.sqrt((local**2 * used).sum(axis=(0, -1)) / count)
    scale = np.where(scale > 0, scale, 1.0)
    return local / scale[:, None], offset, scale


def _smallest_solution(rays, homogeneous, used, solutions):
    """Matrices M (B, 3, D) minimising Σ w |(I − b bᵀ) M X|² over unit M, X = homogeneous (D, B, N)."""
    size = len(homogeneous)
    views = used.shape[0]
    weights = used.astype(float)
    pairs = [(i, j) for i in range(size) for j in range(i, size)]
    outer = np.stack([homogeneous[i] * homogeneous[j] for i, j in pairs], axis=1)
    projector = np.stack(
        [(i == j) - rays[i] * rays[j] for i, j in ((0, 0), (0, 1), (0, 2), (1, 1), (1, 2), (2, 2))], axis=1
    )
    index = np.zeros((size, size), dtype=int)
    for position, (i, j) in enumerate(pairs):
        index[i, j] = index[j, i] = position
    ray_index = np.array([[0, 1, 2], [1, 3, 4], [2, 4, 5]])
    outer_rows = outer.reshape(views, len(pairs), -1)
    solution = None
    for _ in range(solutions):
        products = (projector * weights[:, None]) @ np.swapaxes(outer_rows, 1, 2)
        quadratic = products[:, ray_index[:, None, :, None], index[None, :, None, :]]
        quadratic = quadratic.reshape(views, 3 * size, 3 * size)
        _, vectors = np.linalg.eigh(quadratic)
        solution = vectors[:, :, 0].reshape(views, 3, size)
        mapped = np.einsum("bij,jbn->ibn", solution, homogeneous)
        along = (mapped * rays).sum(axis=0)
        side = np.sign((np.sign(along) * used).sum(axis=-1))
        side = np.where(side == 0, 1.0, side)
        solution = solution * side[:, None, None]
        length = np.sqrt((mapped**2).sum(axis=0))
        sine = np.sqrt(np.maximum(1 - (along / np.maximum(length, 1e-300)) ** 2, 0.0))
        sine = np.where(along * side[:, None] > 0, sine, 1.0)
        middle = np.maximum(used.sum(axis=-1) - 1, 0) // 2
        median = np.sort(np.where(used, sine, np.inf), axis=-1)[np.arange(views), middle]
        ratio = sine / np.maximum(3 * median, 1e-9)[:, None]
        weights = used / (1 + ratio**2) / np.maximum(length, 1e-12) ** 2
    return solution


def _planar_poses(rays, object_points, used, axes, middle, solutions):
    local, offset, scale = _normalised(object_points, used, axes, middle)
    homogeneous = np.stack([local[0], local[1], np.ones_like(local[0])])
    homography = _smallest_solution(rays, homogeneous, used, solutions)
    first, second, third = (homography[..., i] for i in range(3))
    length = 0.5 * (np.linalg.norm(first, axis=-1) + np.linalg.norm(second, axis=-1))
    length = np.maximum(length, 1e-12)[:, None]
    matrix = np.stack([first / length, second / length, np.cross(first, second) / length**2], axis=-1)
    return _pose(nearest_rotation(matrix), third / length * scale[:, None], axes, middle, offset)


def _spatial_poses(rays, object_points, used, axes, middle, solutions):
    local, offset, scale = _normalised(object_points, used, axes, middle)
    solution = _smallest_solution(rays, np.concatenate([local, np.ones_like(local[:1])]), used, solutions)
    length = np.cbrt(np.linalg.det(solution[..., :3]))[:, None]
    length = np.where(np.abs(length) < 1e-12, 1e-12, length)
    rotation = nearest_rotation(solution[..., :3] / length[..., None])
    return _pose(rotation, solution[..., 3] / length * scale[:, None], axes, middle, offset)


def _pose(rotation, translation, axes, middle, offset):
    """camera_from_target (B, 4, 4) from the pose of the board's own, centred frame."""
    poses = np.tile(np.eye(4), (len(rotation), 1, 1))
    poses[:, :3, :3] = rotation @ axes.T
    origin = axes.T @ middle + offset.T
    poses[:, :3, 3] = translation - np.einsum("bij,bj->bi", rotation, origin)
    return poses
