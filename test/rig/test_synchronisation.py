"""Images of the same time."""

from __future__ import annotations

import numpy as np
import pytest

from fisheye_ep_calib.errors import InputError
from fisheye_ep_calib.rig.synchronisation import nearest_ns, simultaneous, stamps_of_names


def test_jitter_missing_images_and_order_do_not_matter() -> None:
    rng = np.random.default_rng(0)
    times = 10**8 * np.arange(50)
    taken = [rng.permutation(np.flatnonzero(rng.random(50) < 0.8)) for _ in range(3)]
    stamps = [times[which] + rng.integers(-(10**6), 10**6, len(which)) for which in taken]
    moments = simultaneous(stamps, 2 * 10**6)
    of_image = [np.where(moments[:, c] >= 0, taken[c][moments[:, c]], -1) for c in range(3)]
    expected = [[t if t in taken[c] else -1 for c in range(3)] for t in range(50)]
    assert np.stack(of_image, axis=1).tolist() == [row for row in expected if max(row) >= 0]


def test_a_wide_tolerance_still_takes_the_nearest() -> None:
    front, rear = np.array([0, 100, 200, 300]), np.array([98, 203, 299])
    assert simultaneous([front, rear], 60).tolist() == [[0, -1], [1, 0], [2, 1], [3, 2]]
    assert simultaneous([front, rear], 10**6).tolist()[1:] == [[1, 0], [2, 1], [3, 2]]


def test_no_moment_is_longer_than_the_tolerance() -> None:
    moments = simultaneous([np.array([0]), np.array([6]), np.array([12])], 10)
    assert moments.tolist() == [[0, 0, -1], [-1, -1, 0]]


def test_zero_tolerance_and_cameras_without_images() -> None:
    assert simultaneous([np.array([3, 5]), np.array([5, 4]), np.array([], int)], 0).tolist() == [
        [0, -1, -1],
        [-1, 1, -1],
        [1, 0, -1],
    ]


def test_nearest() -> None:
    assert nearest_ns(np.array([50, 10]), np.array([23, 90])) == 13


def test_stamps_of_names() -> None:
    assert stamps_of_names(["1700000000.000000005", "12.500000000"]).tolist() == [1700000000000000005, 12500000000]
    with pytest.raises(InputError, match="left_1.png"):
        stamps_of_names(["1.000000000", "left_1.png"])
