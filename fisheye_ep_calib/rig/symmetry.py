"""How a target looks like itself: a plain lattice turned by 180° is the same lattice, its points counted otherwise."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from fisheye_ep_calib.arrays import IntArray
from fisheye_ep_calib.target.shape.frame import board_frame

_SAME = 1e-3  # of the distance of nearest neighbours


@dataclass(frozen=True)
class Symmetry:
    """A turn S that maps the target onto itself: S P_i = P_j with j = becomes[i].

    motion (4, 4): target_from_target. becomes (n,) int.
    """

    motion: np.ndarray
    becomes: np.ndarray

    def relabelled(self, point_index: np.ndarray) -> np.ndarray:
        """What points are truly called that were counted on the turned target.

        Where points are called so, the pose that was found, times ``motion``, is the true one.
        """
        true_index: IntArray = np.argsort(self.becomes)[point_index]
        return true_index


def no_symmetry(object_points: np.ndarray) -> tuple[Symmetry, ...]:
    """For targets whose points cannot be mistaken: the turn by nothing alone."""
    return (Symmetry(np.eye(4), np.arange(len(object_points))),)


def symmetries(object_points: np.ndarray) -> tuple[Symmetry, ...]:
    """The turns in the plane of a flat target that leave its points (n, 3) where points are, the identity first.

    Only turns: a detector keeps the handedness of what it sees.
    """
    from scipy.spatial import cKDTree

    turns = list(no_symmetry(object_points))
    frame = board_frame(object_points)
    if not frame.planar or len(object_points) < 2:
        return tuple(turns)
    tree = cKDTree(object_points)
    spacing = tree.query(object_points, k=2)[0][:, 1].min()
    for quarters in (1, 2, 3):
        cosine, sine = ((0, 1), (-1, 0), (0, -1))[quarters - 1]
        turn = frame.axes @ np.array([[cosine, -sine, 0], [sine, cosine, 0], [0, 0, 1]]) @ frame.axes.T
        motion = np.eye(4)
        motion[:3, :3] = turn
        motion[:3, 3] = frame.middle - turn @ frame.middle
        distance, becomes = tree.query(object_points @ turn.T + motion[:3, 3])
        if distance.max() < _SAME * spacing and len(np.unique(becomes)) == len(becomes):
            turns.append(Symmetry(motion, becomes))
    return tuple(turns)
