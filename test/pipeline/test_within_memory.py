"""An observation file asks for no more memory than is planned for, however many images it holds."""

from __future__ import annotations

import logging

import numpy as np
import pytest

from fisheye_ep_calib import Observations
from fisheye_ep_calib.pipeline.camera_source import MOST_IMAGES, MOST_PLACES, source_of_observations, within_memory


def seen(images: int, points: int, share: float = 1.0) -> Observations:
    """Points of a target, some of them in each image."""
    shown = int(points * share)
    return Observations.create(
        np.c_[np.arange(points) % 100, np.arange(points) // 100, np.zeros(points)] * 0.01,
        np.repeat(np.arange(images), shown),
        np.tile(np.arange(shown), images),
        np.ones((images * shown, 2)),
        (640, 480),
    )


@pytest.mark.parametrize("images, points, share", [(9000, 8, 1.0), (3000, 77, 1.0), (60, 10_000, 0.3), (20, 10_000, 1)])
def test_more_images_than_there_is_memory_for(images, points, share, caplog) -> None:
    source = source_of_observations("camera", seen(images, points, share))
    with caplog.at_level(logging.WARNING):
        kept = within_memory(source).observations
    numbers = np.unique(kept.image_index)
    assert 8 <= len(numbers) <= MOST_IMAGES
    assert (2 * len(kept.pixels) + len(numbers) * points) / 3 <= MOST_PLACES
    assert numbers[0] == 0 and numbers[-1] == images - 1, "from the first to the last"
    assert np.ptp(np.diff(numbers)) <= 1, "evenly spaced"
    np.testing.assert_array_equal(kept.object_points, source.observations.object_points)
    assert f"{len(numbers)} of {images} images are used" in caplog.text


@pytest.mark.parametrize("images, points, share", [(1000, 77, 1.0), (1200, 8, 1.0), (300, 484, 0.3), (8, 10_000, 1)])
def test_what_there_is_memory_for_stays_as_it_is(images, points, share, caplog) -> None:
    source = source_of_observations("camera", seen(images, points, share))
    assert within_memory(source) is source
    assert not caplog.text
