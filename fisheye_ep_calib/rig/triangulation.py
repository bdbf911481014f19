"""Points from rays that do not share an origin: neither those of two cameras, nor those of one with a moving pupil."""

from __future__ import annotations

import numpy as np


def triangulate(origins: np.ndarray, directions: np.ndarray, used: np.ndarray | None = None) -> np.ndarray:
    """The points (..., 3) nearest to their rays, in the sense of least squares.

    origins, directions (views, ..., 3): in one frame, metres and unit vectors, as ``FisheyeCamera.unproject`` gives
    them once they are turned and moved into it (``rays_in``). used (views, ...): which rays count; default all.
    Minimises Σ |(I − d dᵀ)(X − o)|², so that Σ (I − d dᵀ) X = Σ (I − d dᵀ) o. NaN where fewer than two rays, or
    parallel ones, leave the point open.
    """
    across = np.eye(3) - directions[..., :, None] * directions[..., None, :]
    if used is not None:
        across = np.where(used[..., None, None], across, 0.0)
        origins = np.where(used[..., None], origins, 0.0)
    matrix = across.sum(axis=0)
    right = (across @ origins[..., None]).sum(axis=0)
    open_ = ~(np.linalg.eigvalsh(np.where(np.isfinite(matrix), matrix, 0.0))[..., 0] > 1e-12)
    solution = np.linalg.solve(np.where(open_[..., None, None], np.eye(3), matrix), right)[..., 0]
    return np.where(open_[..., None], np.nan, solution)


def rays_in(pose: np.ndarray, origins: np.ndarray, directions: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Rays (..., 3) of a camera in another frame, by the camera's pose in it, frame_from_camera (4, 4)."""
    rotation = pose[:3, :3]
    return origins @ rotation.T + pose[:3, 3], directions @ rotation.T
