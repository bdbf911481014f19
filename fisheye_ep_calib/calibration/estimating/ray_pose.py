"""Poses from rays: where a target of known shape is, given the unit ray to each of its points.

Planar views: a homography from rays. With b the unit ray and X = (x, y, 1) on the board, b × (H X) = 0; the sum
over a view of |(I − b bᵀ) H X|² is a quadratic form in H whose smallest eigenvector is the answer
(Hartley and Zisserman, Multiple View Geometry, 4.1, on rays instead of image points). Other views: the same with
X = (x, y, z, 1) and the 3×4 matrix (R | t).
"""

import numpy as np

from fisheye_ep_calib.arrays import BoolArray, FloatArray
from fisheye_ep_calib.rotation import nearest_rotation
from fisheye_ep_calib.target.shape.frame import BoardFrame

_SAMPLES = 32  # a tenth of wrong sightings leaves no clean sample once in 1e10
_SAMPLE_SIZE = {3: 6, 4: 8}  # sightings a sample, by the number of homogeneous coordinates


def poses_from_rays(
    rays: np.ndarray,
    object_points: np.ndarray,
    used: np.ndarray,
    board: BoardFrame,
    solutions: int = 4,
    robust: bool = False,
) -> np.ndarray:
    """Poses camera_from_target (B, 4, 4).

    rays (3, B, N): unit, camera frame. object_points (3, B, N): metres, target frame. used (B, N): bool.
    solutions: how often to solve; each time sightings far off the last solution weigh less.
    robust: start from the best of many small samples (Fischler and Bolles' consensus) instead of all sightings.
    Views of a target with depth of which fewer than three sightings are used get the identity.
    """
    if board.planar:
        return _poses(rays, object_points, used, board.axes, board.middle, solutions, robust, flat=True)
    poses = np.tile(np.eye(4), (used.shape[0], 1, 1))
    for view in np.flatnonzero(used.sum(axis=-1) >= 3):
        points = object_points[:, view][:, used[view]].T
        middle = points.mean(axis=0)
        _, extent, rows = np.linalg.svd(points - middle, full_matrices=False)  # n × n otherwise
        rows[2] *= np.sign(np.linalg.det(rows))
        selected = (slice(None), slice(view, view + 1))
        flat = bool(extent[2] < 1e-3 * extent[0])
        own = used[view : view + 1]
        poses[view] = _poses(rays[selected], object_points[selected], own, rows.T, middle, solutions, robust, flat)[0]
    return poses


def _normalised(
    object_points: np.ndarray, used: np.ndarray, axes: np.ndarray, middle: np.ndarray
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Board coordinates (3, B, N), centred and scaled a view, with offset (3, B) and scale (B,)."""
    local = np.tensordot(axes.T, object_points - middle[:, None, None], axes=1)
    count = np.maximum(used.sum(axis=-1), 1)
    offset = (local * used).sum(axis=-1) / count
    local = local - offset[..., None]
    scale = np.sqrt((local**2 * used).sum(axis=(0, -1)) / count)
    scale = np.where(scale > 0, scale, 1.0)
    return local / scale[:, None], offset, scale


def _smallest_solution(
    rays: np.ndarray, homogeneous: np.ndarray, used: np.ndarray, solutions: int, robust: bool
) -> np.ndarray:
    """Matrices M (B, 3, D) minimising Σ w |(I − b bᵀ) M X|² over unit M, X = homogeneous (D, B, N)."""
    weights = _consensus_weights(rays, homogeneous, used) if robust else used.astype(float)
    outer, projector = _products(homogeneous), _projectors(rays)
    for repeat in range(solutions):
        solution = _eigen_solution(outer, projector, weights, len(homogeneous))
        solution, sine, length = _facing_forward(solution, rays, homogeneous, used)
        if repeat + 1 < solutions:
            ratio = sine / np.maximum(3 * _median(sine, used), 1e-9)[:, None]
            weights = used / (1 + ratio**2) / np.maximum(length, 1e-12) ** 2
    return solution


def _products(homogeneous: np.ndarray) -> np.ndarray:
    """The distinct entries of X Xᵀ, (B, D (D + 1) / 2, N)."""
    size = len(homogeneous)
    return np.stack([homogeneous[i] * homogeneous[j] for i in range(size) for j in range(i, size)], axis=1)


def _projectors(rays: np.ndarray) -> np.ndarray:
    """The six distinct entries of I − b bᵀ, (B, 6, N)."""
    return np.stack([(i == j) - rays[i] * rays[j] for i in range(3) for j in range(i, 3)], axis=1)


def _symmetric_index(size: int) -> np.ndarray:
    """(size, size): where an entry of a symmetric matrix stands among its distinct entries."""
    index = np.zeros((size, size), dtype=int)
    rows, columns = np.triu_indices(size)
    index[rows, columns] = index[columns, rows] = np.arange(len(rows))
    return index


def _eigen_solution(outer: np.ndarray, projector: np.ndarray, weights: np.ndarray, size: int) -> np.ndarray:
    """Smallest eigenvectors of Σ w (I − b bᵀ) ⊗ X Xᵀ as matrices (B, 3, D)."""
    products = (projector * weights[:, None]) @ np.swapaxes(outer, 1, 2)
    rays_index, points_index = _symmetric_index(3), _symmetric_index(size)
    quadratic = products[:, rays_index[:, None, :, None], points_index[None, :, None, :]]
    return _smallest_eigenvector(quadratic.reshape(-1, 3 * size, 3 * size)).reshape(-1, 3, size)


def _smallest_eigenvector(matrix: FloatArray) -> FloatArray:
    """Unit eigenvectors (B, n) to the smallest eigenvalues of positive semidefinite matrices (B, n, n).

    The inverse, squared four times, is v vᵀ but for (λ₁/λ₂)¹⁶ (Golub and Van Loan, Matrix Computations, 8.2: inverse
    iteration); for many small matrices it takes a third of the time of all their eigenvectors.
    """
    size = matrix.shape[-1]
    shift = 1e-14 * np.trace(matrix, axis1=1, axis2=2) + 1e-300
    power = np.linalg.inv(matrix + shift[:, None, None] * np.eye(size))
    for _ in range(4):
        power = power / np.abs(power).max(axis=(1, 2), keepdims=True)
        power = power @ power
    diagonal = np.einsum("bii->bi", power)
    vector = power[np.arange(len(power)), :, np.argmax(diagonal, axis=1)]
    unit: FloatArray = vector / np.linalg.norm(vector, axis=1, keepdims=True)
    return unit


def _facing_forward(
    solution: np.ndarray, rays: np.ndarray, homogeneous: np.ndarray, used: np.ndarray
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """The sign for which points lie along their rays; sines (B, N) of the angles left; |M X| (B, N)."""
    mapped = np.einsum("bij,jbn->ibn", solution, homogeneous)
    along = (mapped * rays).sum(axis=0)
    side = np.where((np.sign(along) * used).sum(axis=-1) < 0, -1.0, 1.0)
    length = np.sqrt((mapped**2).sum(axis=0))
    sine = np.sqrt(np.maximum(1 - (along / np.maximum(length, 1e-300)) ** 2, 0.0))
    sine = np.where(along * side[:, None] > 0, sine, 1.0)
    return solution * side[:, None, None], sine, length


def _median(values: FloatArray, used: BoolArray) -> FloatArray:
    """Lower median (B,) of the used entries of values (B, N)."""
    middle = np.maximum(used.sum(axis=-1) - 1, 0) // 2
    median: FloatArray = np.sort(np.where(used, values, np.inf), axis=-1)[np.arange(len(used)), middle]
    return median


def _consensus_weights(rays: np.ndarray, homogeneous: np.ndarray, used: BoolArray) -> FloatArray:
    """Weights (B, N) after the best of _SAMPLES solutions a view, each from _SAMPLE_SIZE random sightings."""
    views, slots = used.shape
    size = min(_SAMPLE_SIZE[len(homogeneous)], slots)
    order = np.random.default_rng(0).random((views, _SAMPLES, slots)) + ~used[:, None]
    columns = np.argsort(order, axis=-1)[..., :size].reshape(-1, size)
    row = np.repeat(np.arange(views), _SAMPLES)[:, None]
    solution = _eigen_solution(
        _products(homogeneous[:, row, columns]),
        _projectors(rays[:, row, columns]),
        used[row, columns].astype(float),
        len(homogeneous),
    )
    spread = (slice(None), row[:, 0])
    _, sine, _ = _facing_forward(solution, rays[spread], homogeneous[spread], used[row[:, 0]])
    median = _median(sine, used[row[:, 0]]).reshape(views, _SAMPLES)
    best = np.argmin(median, axis=-1)
    limit = np.maximum(4 * median[np.arange(views), best], 1e-9)
    agreeing: BoolArray = used & (sine.reshape(views, _SAMPLES, slots)[np.arange(views), best] <= limit[:, None])
    return agreeing.astype(float)


def _poses(
    rays: np.ndarray,
    object_points: np.ndarray,
    used: np.ndarray,
    axes: np.ndarray,
    middle: np.ndarray,
    solutions: int,
    robust: bool,
    flat: bool,
) -> np.ndarray:
    """camera_from_target (B, 4, 4). axes (3, 3), middle (3,): of the points. flat: they lie in a plane."""
    local, offset, scale = _normalised(object_points, used, axes, middle)
    points = np.concatenate([local[:2] if flat else local, np.ones_like(local[:1])])
    solution = _smallest_solution(rays, points, used, solutions, robust)
    rotation, translation = _of_homography(solution) if flat else _of_projection(solution)
    return _pose(rotation, translation * scale[:, None], axes, middle, offset)


def _of_homography(homography: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Rotations and translations from H = (r₁ r₂ t) (B, 3, 3), each up to a factor."""
    first, second, third = (homography[..., i] for i in range(3))
    length = 0.5 * (np.linalg.norm(first, axis=-1) + np.linalg.norm(second, axis=-1))
    length = np.maximum(length, 1e-12)[:, None]
    matrix = np.stack([first / length, second / length, np.cross(first, second) / length**2], axis=-1)
    return nearest_rotation(matrix), third / length


def _of_projection(projection: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Rotations and translations from (R t) (B, 3, 4), each up to a factor."""
    length = np.cbrt(np.linalg.det(projection[..., :3]))[:, None]
    length = np.where(np.abs(length) < 1e-12, 1e-12, length)
    return nearest_rotation(projection[..., :3] / length[..., None]), projection[..., 3] / length


def _pose(
    rotation: np.ndarray, translation: np.ndarray, axes: np.ndarray, middle: np.ndarray, offset: np.ndarray
) -> np.ndarray:
    """camera_from_target (B, 4, 4) from the pose of the board's own, centred frame."""
    poses = np.tile(np.eye(4), (len(rotation), 1, 1))
    poses[:, :3, :3] = rotation @ axes.T
    origin = axes.T @ middle + offset.T
    poses[:, :3, 3] = translation - np.einsum("bij,bj->bi", rotation, origin)
    return poses
