"""Chains of overlaps: cameras that see nothing in common are joined by those that do."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

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

    The maximum spanning tree (Prim); an ambiguous pair is taken only where nothing else reaches a camera.
    """
    poses = np.tile(np.eye(4), (cameras, 1, 1))
    before = [-1] * cameras
    joined = {0}
    while len(joined) < cameras:
        reaching = [pair for pair in pairs if (pair[0] in joined) != (pair[1] in joined)]
        if not reaching:
            return None
        a, b = max(reaching, key=lambda pair: (not pairs[pair].ambiguous, pairs[pair].views))
        a_from_b = pairs[a, b].a_from_b
        if a in joined:
            poses[b], before[b] = np.linalg.inv(a_from_b) @ poses[a], a
            joined.add(b)
        else:
            poses[a], before[a] = a_from_b @ poses[b], b
            joined.add(a)
    return Chains(poses, tuple(before))


def components(pairs: Sequence[tuple[int, int]], cameras: int) -> list[list[int]]:
    """The groups of cameras that pairs join, each sorted."""
    group = list(range(cameras))
    for a, b in pairs:
        old, new = group[b], group[a]
        group = [new if number == old else number for number in group]
    return [[camera for camera in range(cameras) if group[camera] == number] for number in sorted(set(group))]
