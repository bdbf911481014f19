"""The flat faces of a target that is not flat itself, such as a box of boards.

Each face has a shape of its own. Points that were surveyed one by one lie in no plane together and get none.
"""

from __future__ import annotations

import numpy as np

from fisheye_ep_calib.target.shape.frame import board_frame

_IN_PLANE = 1e-6  # of the target's size, that a point of a face may be off its plane
_LEAST_POINTS = 12  # on a face: fewer say nothing of a shape
_ON_A_LINE = 1e-3  # sine of the angle at a point between two neighbours, below which they span no plane


def faces_of(points: np.ndarray) -> tuple[np.ndarray, ...]:
    """Rows of each face's points (n, 3), metres; a nearly flat target is one face. Empty where some lie on none."""
    if board_frame(points).planar:
        return (np.arange(len(points)),)
    size = float(np.ptp(points, axis=0).max())
    left, faces = np.ones(len(points), bool), []
    while left.any():
        face = _face_of(points, int(np.flatnonzero(left)[0]), left, _IN_PLANE * size)
        if face is None:
            return ()
        faces.append(face)
        left[face] = False
    return tuple(faces)


def _face_of(points: np.ndarray, first: int, left: np.ndarray, tolerance: float) -> np.ndarray | None:
    """Rows of the plane with most of the points left, through one of them and two of its neighbours."""
    arms = points - points[first]
    order = [near for near in np.argsort(np.linalg.norm(arms, axis=1)) if left[near] and near != first][:8]
    best: np.ndarray | None = None
    for place, row in enumerate(order):
        for other in order[place + 1 :]:
            normal = np.cross(arms[row], arms[other])
            length = float(np.linalg.norm(normal))
            if length < _ON_A_LINE * np.linalg.norm(arms[row]) * np.linalg.norm(arms[other]):
                continue
            on_plane = np.flatnonzero(left & (np.abs(arms @ normal) <= tolerance * length))
            if len(on_plane) >= _LEAST_POINTS and (best is None or len(on_plane) > len(best)):
                best = on_plane
    return best
