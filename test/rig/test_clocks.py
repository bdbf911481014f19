"""Clocks that differ by a constant, found by how the target moved; none where it did not."""

from __future__ import annotations

import tracemalloc

import numpy as np
import pytest
from simulated_rig import PERIOD_NS, place, targets_between

from fisheye_ep_calib.rig.clocks import clock_offset, clocks_of_rig
from fisheye_ep_calib.rig.symmetry import symmetries
from fisheye_ep_calib.rig.synchronisation import numbers_of_names
from fisheye_ep_calib.simulation import paper_target

DISCS = paper_target()
PLACES = [np.eye(4), place(60, (0.08, 0.01, -0.03))]
TURNS = symmetries(DISCS.object_points)
TOLERANCE_NS = 10**7


def poses(count: int, seed: int = 0) -> list[np.ndarray]:
    board = targets_between(*PLACES, DISCS, count, seed)
    return [np.linalg.inv(camera) @ board for camera in PLACES]


def found(stamps_a, a, stamps_b, b):
    return clock_offset(stamps_a, a, stamps_b, b, TURNS, DISCS.object_points, TOLERANCE_NS)


@pytest.mark.parametrize("offset", [0, 5 * 10**7, 37 * 10**8, -123456789, 10**18])
def test_the_difference_that_makes_the_views_agree(offset) -> None:
    rng = np.random.default_rng(0)
    a, b = poses(20)
    stamps = 10**18 + PERIOD_NS * np.arange(20)
    kept = rng.permutation(20)[:15]
    b_stamps = stamps + offset + rng.integers(-(10**6), 10**6, 20)
    clock = found(stamps, a, b_stamps[kept], b[kept])
    assert clock is not None and abs(clock.offset_ns - offset) < 10**6
    assert clock.common == clock.agreeing == 15


def test_thousands_of_images_compare_a_part_of_their_stamps() -> None:
    a, b = poses(5000)
    stamps = 10**18 + np.cumsum(np.random.default_rng(0).integers(5 * 10**7, 15 * 10**7, 5000))
    tracemalloc.start()
    clock = found(stamps, a, stamps + 37 * 10**8, b)
    most = tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()
    assert clock is not None and clock.offset_ns == 37 * 10**8 and clock.agreeing == 5000
    assert most < 3e8  # bytes; every pair of images takes more than a gigabyte


def test_a_board_at_rest_does_not_tell() -> None:
    a, b = (np.repeat(one, 10, axis=0) for one in poses(1))
    stamps = PERIOD_NS * np.arange(10)
    assert found(stamps, a, stamps, b) is None


def test_views_that_never_agree() -> None:
    (a, _), (_, b) = poses(12, 1), poses(12, 2)
    assert found(PERIOD_NS * np.arange(12), a, PERIOD_NS * np.arange(12), b) is None
    assert found(np.empty(0), a[:0], PERIOD_NS * np.arange(12), b) is None


def test_clocks_of_a_chain() -> None:
    a, b = poses(12)
    stamps = PERIOD_NS * np.arange(12)
    seen = [dict(enumerate(a)), dict(enumerate(b)), {}]
    clocks = clocks_of_rig([stamps, stamps + 7 * 10**9, stamps], seen, TURNS, DISCS.object_points, TOLERANCE_NS)
    assert clocks == [0, 7 * 10**9, None]


@pytest.mark.parametrize(
    "names, expected",
    [
        ((["a1.png", "a2.png"], ["b1.png", "b2.png"]), ([1, 2], [1, 2])),
        ((["1_cam0.png", "2_cam0.png"], ["1_cam1.png"]), None),
        ((["a.png"], ["b.png"]), None),
        ((["a1.png", "a2.png", "a3.png"], ["b11.png", "b12.png", "b3.png"]), None),
    ],
)
def test_numbers_of_names(names, expected) -> None:
    numbers = numbers_of_names(names)
    assert (numbers is None) if expected is None else [one.tolist() for one in numbers] == list(map(list, expected))
