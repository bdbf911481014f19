"""Symmetries of targets, and the pose between two cameras on which their views agree."""

from __future__ import annotations

import tracemalloc

import numpy as np
import pytest
from simulated_rig import errors, place, targets_between

from fisheye_ep_calib.rig.graph import components, join
from fisheye_ep_calib.rig.pairs import PairPose, pair_pose
from fisheye_ep_calib.rig.symmetry import no_symmetry, symmetries
from fisheye_ep_calib.rotation import moved_poses
from fisheye_ep_calib.simulation import paper_target
from fisheye_ep_calib.target.boards.chessboard import Chessboard
from fisheye_ep_calib.target.boards.circle_grid import CircleGrid


@pytest.mark.parametrize(
    ("target", "count"),
    [
        (paper_target(), 2),
        (Chessboard.create("square", 7, 7, 0.02), 4),
        (Chessboard.create("oblong squares", 7, 7, 0.02, 0.03), 2),
        (CircleGrid.create("asymmetric", 4, 11, 0.02, 0.005, asymmetric=True), 1),
        (CircleGrid.create("asymmetric", 4, 10, 0.02, 0.005, asymmetric=True), 2),
    ],
    ids=lambda value: value if isinstance(value, int) else value.name,
)
def test_turns_that_a_target_cannot_be_told_from(target, count) -> None:
    points = target.object_points
    turns = symmetries(points)
    assert len(turns) == count
    for turn in turns:
        moved = points @ turn.motion[:3, :3].T + turn.motion[:3, 3]
        assert np.allclose(moved, points[turn.becomes])
        assert (turn.relabelled(turn.becomes) == np.arange(len(points))).all()


A_FROM_B = np.linalg.inv(place(65, (0.07, 0.01, -0.02), (0.03, 0, 0.1)))
TARGET = paper_target()


def seen_by_both(count: int, seed: int = 0, noise: float = 1e-4, flipped: bool = True):
    """Poses in both cameras, with noise and each counted from either end."""
    rng = np.random.default_rng(seed)
    b_from_target = targets_between(np.eye(4), np.linalg.inv(A_FROM_B), TARGET, count, seed)
    poses = [A_FROM_B @ b_from_target, b_from_target]
    turn = np.linalg.inv(symmetries(TARGET.object_points)[1].motion)
    for number in range(2):
        poses[number] = moved_poses(poses[number], rng.normal(0, noise, (count, 6)))
        if flipped:
            flips = rng.random(count) < 0.5
            poses[number][flips] = poses[number][flips] @ turn
    return poses


@pytest.mark.parametrize("seed", range(10))
def test_the_views_agree_on_the_pose_whichever_end_they_count_from(seed) -> None:
    a, b = seen_by_both(6, seed)
    found = pair_pose(a, b, symmetries(TARGET.object_points), TARGET.object_points)
    angle, distance = errors(found.a_from_b, A_FROM_B)
    assert found.views == 6 and not found.ambiguous and angle < 2e-3 and distance < 1e-3


def test_wrong_views_are_outvoted() -> None:
    a, b = seen_by_both(12)
    b[:5] = seen_by_both(5, seed=99)[1]
    found = pair_pose(a, b, symmetries(TARGET.object_points), TARGET.object_points)
    assert found.views == 7 and errors(found.a_from_b, A_FROM_B)[1] < 1e-3


def test_thousands_of_views_cost_as_many_times_one() -> None:
    """Of every 20 views 9 are wrong, at regular places; memory goes with the views, not with their pairs."""
    a, b = seen_by_both(3000)
    wrong = np.arange(3000) % 20 < 9
    b[wrong] = seen_by_both(int(wrong.sum()), seed=99)[1]
    tracemalloc.start()
    found = pair_pose(a, b, symmetries(TARGET.object_points), TARGET.object_points)
    most = tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()
    assert 1650 <= found.views < 1750  # few of the wrong ones agree by chance
    assert errors(found.a_from_b, A_FROM_B)[1] < 1e-3
    assert most < 3e8  # bytes; every pair of views takes gigabytes


def test_a_target_that_never_moves_does_not_tell_which_way_it_is() -> None:
    a, b = (np.repeat(poses, 5, axis=0) for poses in seen_by_both(1))
    points = TARGET.object_points
    assert pair_pose(a, b, symmetries(points), points).ambiguous
    a, b = (np.repeat(poses, 5, axis=0) for poses in seen_by_both(1, flipped=False))
    assert not pair_pose(a, b, no_symmetry(points), points).ambiguous


def test_chains_prefer_many_views_and_avoid_what_is_ambiguous() -> None:
    truth = [np.eye(4), place(40, (0.1, 0, 0)), place(80, (0.2, 0, 0.1)), place(120, (0.2, 0, 0.3))]

    def pair(a: int, b: int, views: int, ambiguous: bool = False) -> PairPose:
        return PairPose(np.linalg.inv(truth[a]) @ truth[b], views, 0.0, ambiguous)

    pairs = {(0, 1): pair(0, 1, 9), (1, 2): pair(1, 2, 8), (0, 2): pair(0, 2, 3), (2, 3): pair(2, 3, 5)}
    chains = join(pairs, 4)
    assert [chains.path(camera) for camera in range(4)] == [(0,), (0, 1), (0, 1, 2), (0, 1, 2, 3)]
    for camera in range(4):
        assert np.allclose(chains.camera_from_reference[camera], np.linalg.inv(truth[camera]))
    pairs[1, 2] = pair(1, 2, 8, ambiguous=True)
    assert join(pairs, 4).path(3) == (0, 2, 3)
    assert join({(0, 1): pair(0, 1, 9)}, 4) is None
    assert components([(0, 3), (1, 2)], 5) == [[0, 3], [1, 2], [4]]
