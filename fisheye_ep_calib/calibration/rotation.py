"""Rotations for whole batches: the exponential map and pose updates."""

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
    return np.eye(3) + a[..., None, None] * skew + b[..., None, None] * (skew @ skew)


def moved_poses(poses: np.ndarray, step: np.ndarray) -> np.ndarray:
    """Poses (..., 4, 4) after steps (..., 6) = (ω, δt): R ← exp(ω) R, t ← t + δt; rad, metres."""
    moved = poses.copy()
    moved[..., :3, :3] = rotation_from_vector(step[..., :3]) @ poses[..., :3, :3]
    moved[..., :3, 3] += step[..., 3:]
    return moved


def nearest_rotation(matrix: np.ndarray) -> np.ndarray:
    """The rotations (..., 3, 3) nearest to matrices (..., 3, 3), by singular value decomposition."""
    left, _, right = np.linalg.svd(matrix)
    sign = np.sign(np.linalg.det(left @ right))
    left[..., :, 2] *= sign[..., None]
    return left @ right
