"""The overlay shows what was found and where to go, at the right places, on images of any size."""

from __future__ import annotations

import numpy as np
import pytest

from fisheye_ep_calib.live.overlay import COVERED, FOUND, LONGEST_SIDE, WANTED, OverlayRequest, draw_overlay
from fisheye_ep_calib.target import Detection

NOTHING = np.empty((0, 2))


@pytest.mark.parametrize("size", [(640, 480), (3000, 2000), (30, 20)])
def test_what_is_drawn_lies_where_it_was_seen(size: tuple[int, int]) -> None:
    width, height = size
    scale = min(1.0, LONGEST_SIDE / max(size))
    image = np.full((height, width), 100, np.uint8)
    points = np.array([[0.5 * width, 0.5 * height]])
    seen = Detection(np.array([0]), points)
    picture = draw_overlay(image, seen, OverlayRequest(NOTHING, NOTHING, ()))
    assert max(picture.shape[:2]) == min(LONGEST_SIDE, max(size)) and picture.dtype == np.uint8
    changed = np.argwhere((picture != 100).any(axis=2))
    np.testing.assert_allclose(changed.mean(axis=0), points[0][::-1] * scale, atol=1.5)


def test_every_part_has_its_colour() -> None:
    image = np.zeros((480, 640), np.uint8)
    square = np.array([[300.0, 200.0], [400.0, 200.0], [400.0, 300.0], [300.0, 300.0]])
    request = OverlayRequest(np.array([[100.0, 300.0]]), square, ("front: 3 views", "hold it 40° off the axis"))
    picture = draw_overlay(image, Detection(np.array([0]), np.array([[500.0, 400.0]])), request)
    assert tuple(picture[200, 350]) == WANTED
    np.testing.assert_allclose(picture[300, 100], np.array(COVERED) / 4, atol=1)
    assert np.abs(picture[390:411, 490:511].astype(int) - FOUND).sum(axis=2).min() < 80
    assert (picture[:60] > 150).any()
