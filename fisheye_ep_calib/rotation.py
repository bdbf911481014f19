"""Rotations for whole batches: the exponential map and back, pose updates, and how points follow a motion."""

import numpy as np


def rotation_from_vector(vector: np.ndarray) -> np.ndarray:
    """Rotation vectors (..., 3), rad, to matrices (..., 3, 3), by Rodrigues' formula.

    R = I + sin φ/φ [ω]× + (1 − cos φ)/φ² [ω]×², φ = |ω|; (1 − cos φ)/φ² = ½ (sin ½φ / ½φ)², without cancellation.
    """
    vector = np.asarray(vector, dtype=float)
    angle = np.linalg.norm(vector, axis=-1)[..., None, None]
    cross = np.zeros((*vector.shape, 3))
    for axis in range(3):
        after, last = (axis + 1) % 3, (axis + 2) % 3
        cross[..., last, after], cross[..., after, last] = vector[..., axis], -vector[..., axis]
    # numpy's sinc(x) is sin πx / πx.
    result: np.ndarray = (
        np.eye(3) + np.sinc(angle / np.pi) * cross + 0.5 * np.sinc(angle / (2 * np.pi)) ** 2 * (cross @ cross)
    )
    return result


def vector_from_rotation(rotation: np.ndarray) -> np.ndarray:
    """Rotation vectors (..., 3), rad, of rotations (..., 3, 3), none longer than π.

    The unit quaternion (w, v) = (cos ½φ, sin ½φ ω/φ) of R is the eigenvector of the largest eigenvalue of a symmetric
    matrix, at every angle (Bar-Itzhack, "New method for extracting the quaternion from a rotation matrix", J. Guidance
    23, 2000); SciPy's way takes longer to load than a calibration.
    """
    matrix = np.empty((*rotation.shape[:-2], 4, 4))
    trace = np.trace(rotation, axis1=-2, axis2=-1)
    across = np.swapaxes(rotation, -1, -2)
    matrix[..., 1:, 1:] = rotation + across - trace[..., None, None] * np.eye(3)
    matrix[..., 0, 0] = trace
    for axis in range(3):
        after, last = (axis + 1) % 3, (axis + 2) % 3
        matrix[..., 0, 1 + axis] = matrix[..., 1 + axis, 0] = rotation[..., last, after] - rotation[..., after, last]
    quaternion = np.linalg.eigh(matrix)[1][..., -1]
    quaternion = np.where(quaternion[..., :1] < 0, -quaternion, quaternion)
    sine = np.linalg.norm(quaternion[..., 1:], axis=-1, keepdims=True)
    half = np.arctan2(sine, quaternion[..., :1])
    result: np.ndarray = 2 * quaternion[..., 1:] * np.where(sine > 0, half / np.where(sine > 0, sine, 1.0), 1.0)
    return result


def placed(poses: np.ndarray, point: np.ndarray) -> np.ndarray:
    """Where poses (..., 4, 4) put a point (3,) of the posed frame, (..., 3)."""
    result: np.ndarray = poses[..., :3, :3] @ point + poses[..., :3, 3]
    return result


def turn_jacobian(arms: np.ndarray, d_point: np.ndarray, out: np.ndarray | None = None) -> np.ndarray:
    """∂f/∂ω = a × ∂f/∂p, (K, 3, *S), of K functions of points p = c + ω × a, from ∂f/∂p (K, 3, *S).

    arms a (3, *S), or of a shape that broadcasts to it. out: where to put it.
    """
    result = np.empty(d_point.shape) if out is None else out
    for axis in range(3):
        after, last = (axis + 1) % 3, (axis + 2) % 3
        np.multiply(arms[after], d_point[:, last], out=result[:, axis])
        result[:, axis] -= arms[last] * d_point[:, after]
    return result


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
