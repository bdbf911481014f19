"""Where nothing is found, the images to look at are bounded by their pixels and spread from end to end."""

from __future__ import annotations

import numpy as np

from fisheye_ep_calib.planning.nothing_found import FEWEST_IMAGES, MOST_PIXELS, evenly_spread, worth_a_look


def looked_at(count: int, pixels: int) -> list[int]:
    """Images looked at, of a recording that shows nothing, until no more are worth it."""
    looked: list[int] = []
    while chosen := worth_a_look([i for i in range(count) if i not in looked], [pixels] * len(looked)):
        looked += chosen
    assert len(set(looked)) == len(looked)
    return sorted(looked)


def test_as_many_pixels_as_a_refusal_may_cost():
    few = looked_at(150, 2048**2)
    assert len(few) == MOST_PIXELS // 2048**2 == 14
    assert few[0] < 15 and few[-1] >= 135 and np.diff(few).max() <= 20
    assert looked_at(150, 640 * 480) == list(range(150))
    assert len(looked_at(150, 100_000_000)) == FEWEST_IMAGES
    assert looked_at(4, 100_000_000) == [0, 1, 2, 3]


def test_images_that_cannot_be_read_cost_nothing():
    assert worth_a_look(range(6, 100), [0] * 6) == list(range(6, 100))
    # Two of six were read: the others of the recording are expected to be alike.
    assert len(worth_a_look(range(1000), [0, 0, 0, 0, 4_000_000, 4_000_000])) == (60 - 8) * 6 // 8


def test_one_of_several_cameras_images_each():
    assert len(worth_a_look(range(100), [4_000_000] * 12, at_once=2)) == (60 - 48) // 8


def test_spread():
    assert evenly_spread([3, 5, 9], 3) == [3, 5, 9]
    assert evenly_spread(range(0, 101), 3) == [16, 50, 84]
    assert evenly_spread([3, 5, 9], 0) == evenly_spread([], 4) == []
