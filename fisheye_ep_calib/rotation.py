"""Rotations for whole batches: the exponential map and back, pose updates, and how points follow a motion."""

import numpy as np


def rotation_from_vector(vector: np.ndarray) -> np.ndarray:
    """Rodrigues' formula: rotation vectors (..., 3), rad, to matrices (..., 3, 3).

    R = I + a [v]× + b [v]×², a = sin|v|/|v|, b = (1 − cos|v|)/|v|², by their series near zero.
    """
    vector = np.asarray(vector, dtype=float)
    square = (vector * vector).sum(axis=-1)
    angle = np.sqrt(square)
    small = angle < 1e-4
    safe = np.where(small, 1.0, angle)
    a = np.where(small, 1 - square / 6, np.sin(safe) / safe)
    b = np.where(small, 0.5 - square / 24, 2 * np.sin(safe / 2) ** 2 / (safe * safe))
    skew = np.zeros((*vector.shape[:-1], 3, 3))
    skew[..., 0, 1], skew[..., 0, 2] = -vector[..., 2], vector[..., 1]
    skew[..., 1, 0], skew[..., 1, 2] = vector[..., 2], -vector[..., 0]
    skew[..., 2, 0], skew[..., 2, 1] = -vector[..., 1], vector[..., 0]
    result: np.ndarray = np.eye(3) + a[..., None, None] * skew + b[..., None, None] * (skew @ skew)
    return result


def vector_from_rotation(rotation: np.ndarray) -> np.ndarray:
    """Rotation vectors (..., 3), rad, of rotations (..., 3, 3) by less than π: the axis a times atan2(sin, cos).

    2 sin · a = (R32 − R23, R13 − R31, R21 − R12), 2 cos = tr R − 1.
    """
    axis = 0.5 * np.stack(
        [
            rotation[..., 2, 1] - rotation[..., 1, 2],
            rotation[..., 0, 2] - rotation[..., 2, 0],
            rotation[..., 1, 0] - rotation[..., 0, 1],
        ],
        axis=-1,
    )
    sine = np.linalg.norm(axis, axis=-1, keepdims=True)
    angle = np.arctan2(sine, 0.5 * (np.trace(rotation, axis1=-2, axis2=-1)[..., None] - 1))
    return axis * np.where(sine > 0, angle / np.where(sine > 0, sine, 1.0), 1.0)


def motion_jacobian(arms: np.ndarray) -> np.ndarray:
    """∂(c + ω × a + t)/∂(ω, t) = [−[a]×, I], (..., 3, 6), of points c + a turned by ω about c and shifted by t.

    arms a (..., 3): metres; for a turn about the origin the points themselves.
    """
    x, y, z = (arms[..., i] for i in range(3))
    zero = np.zeros_like(x)
    turn = np.stack([np.stack([zero, z, -y], -1), np.stack([-z, zero, x], -1), np.stack([y, -x, zero], -1)], axis=-2)
    return np.concatenate([turn, np.broadcast_to(np.eye(3), turn.shape)], axis=-1)


def moved_poses(poses: np.ndarray, step: np.ndarray, pivot: np.ndarray | None = None) -> np.ndarray:
    """Poses (..., 4, 4) after steps (..., 6) = (ω, δt): R ← exp(ω) R, R c + t ← R c + t + δt; rad, metres.

    pivot c (3,): the point of the posed frame about which to turn, its origin where None.
    """
    moved = poses.copy()
    moved[..., :3, :3] = rotation_from_vector(step[..., :3]) @ poses[..., :3, :3]
    moved[..., :3, 3] += step[..., 3:]
    if pivot is not None:
        moved[..., :3, 3] += (poses[..., :3, :3] - moved[..., :3, :3]) @ pivot
    return np.asarray(moved)


def nearest_rotation(matrix: np.ndarray) -> np.ndarray:
    """The rotations (..., 3, 3) nearest to matrices (..., 3, 3), by singular value decomposition."""
    left, _, right = np.linalg.svd(matrix)
    sign = np.sign(np.linalg.det(left @ right))
    left[..., :, 2] *= sign[..., None]
    result: np.ndarray = left @ right
    return result
