"""Of a rig's moments those are looked at in which the target is where two cameras see it."""

from __future__ import annotations

import numpy as np
import pytest

from fisheye_ep_calib.planning.image_choice import first_moments, next_moments


@pytest.mark.parametrize("count", [1, 7, 8])
def test_all_where_there_are_few(count: int) -> None:
    assert first_moments(count, 8).tolist() == list(range(count))


def test_half_of_many_from_end_to_end() -> None:
    first = first_moments(1000, 40)
    assert len(first) == 20 and first[0] == 0 and first[-1] == 999
    assert np.ptp(np.diff(first)) <= 1


def test_the_rest_is_next_to_what_two_cameras_saw() -> None:
    looked, shared = np.zeros(1000, bool), np.zeros(1000, bool)
    looked[first_moments(1000, 40)] = True
    shared[np.flatnonzero(looked)[[4, 5]]] = True
    rows = next_moments(looked, shared, 40)
    assert len(rows) == len(set(rows)) == 20 and not looked[rows].any()
    good = np.flatnonzero(shared)
    assert np.abs(np.subtract.outer(rows, good)).min(axis=1).max() <= 6
    looked[rows] = True
    assert len(next_moments(looked, shared, 40)) == 0


def test_none_where_no_two_cameras_saw_it_or_none_is_left() -> None:
    looked = np.arange(10) < 5
    assert len(next_moments(looked, np.zeros(10, bool), 8)) == 0
    assert len(next_moments(np.ones(10, bool), looked, 20)) == 0
