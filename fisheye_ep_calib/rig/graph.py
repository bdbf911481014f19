"""Chains of overlaps: cameras that see nothing in common are joined by those that do."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from scipy.sparse import csr_array
from scipy.sparse.csgraph import breadth_first_order, connected_components, minimum_spanning_tree

from fisheye_ep_calib.rig.pairs import PairPose


@dataclass(frozen=True)
class Chains:
    """camera_from_reference (C, 4, 4), by camera. before (C,): the camera that each hangs on, −1 for the reference."""

    camera_from_reference: np.ndarray
    before: tuple[int, ...]

    def path(self, camera: int) -> tuple[int, ...]:
        """The cameras from the reference to this one."""
        steps = [camera]
        while self.before[steps[-1]] >= 0:
            steps.append(self.before[steps[-1]])
        return tuple(reversed(steps))


def join(pairs: Mapping[tuple[int, int], PairPose], cameras: int) -> Chains | None:
    """Chain pairs (a, b), a < b, from camera 0 to all others, by the pairs with most views; None where some are left.

    The maximum spanning tree; an ambiguous pair is taken only where nothing else reaches a camera.
    """
    best_first = sorted(pairs, key=lambda pair: (pairs[pair].ambiguous, -pairs[pair].views))
    # Ranks, so that no two weights are equal and none is 0, which would say "not joined".
    tree = minimum_spanning_tree(_matrix(best_first, cameras))
    order, before = breadth_first_order(tree, 0, directed=False)
    if len(order) < cameras:
        return None
    poses = np.tile(np.eye(4), (cameras, 1, 1))
    for camera in order[1:].tolist():
        near = int(before[camera])
        a_from_b = pairs[min(near, camera), max(near, camera)].a_from_b
        poses[camera] = (np.linalg.inv(a_from_b) if near < camera else a_from_b) @ poses[near]
    return Chains(poses, tuple(int(max(near, -1)) for near in before))


def components(pairs: Sequence[tuple[int, int]], cameras: int) -> list[list[int]]:
    """The groups of cameras that pairs join, each sorted."""
    count, group = connected_components(_matrix(pairs, cameras), directed=False)
    return [np.flatnonzero(group == number).tolist() for number in range(count)]


def _matrix(pairs: Sequence[tuple[int, int]], cameras: int) -> csr_array:
    """The graph (C, C) whose edges are the pairs, with their ranks 1, 2, … as weights."""
    rows, columns = np.array(pairs, dtype=int).reshape(-1, 2).T
    return csr_array((np.arange(1.0, len(pairs) + 1), (rows, columns)), shape=(cameras, cameras))
