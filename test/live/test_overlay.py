"""The overlay shows what was found and where to go, at the right places, on images of any size."""

from __future__ import annotations

import cv2
import numpy as np
import pytest

from fisheye_ep_calib.live.overlay import (
    COVERED,
    FOUND,
    LONGEST_SIDE,
    REFUSED,
    WANTED,
    OverlayRequest,
    draw_overlay,
    draw_pictures,
)
from fisheye_ep_calib.planning.steering import Steering
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
    pictures = draw_pictures(image, Detection(np.array([0]), np.array([[500.0, 400.0]])), request)
    picture = pictures.raw
    assert picture is not None and pictures.compressed is None and pictures.page is None
    assert tuple(picture[200, 350]) == WANTED
    np.testing.assert_allclose(picture[300, 100], np.array(COVERED) / 4, atol=1)
    assert np.abs(picture[390:411, 490:511].astype(int) - FOUND).sum(axis=2).min() < 80
    assert (picture[:60] > 150).any()


def test_refused_blobs_are_drawn_only_where_they_are_asked_for() -> None:
    image = np.zeros((480, 640), np.uint8)
    seen = Detection(rejected=np.array([[320.0, 240.0]]))
    for refused in (False, True):
        picture = draw_overlay(image, seen, OverlayRequest(NOTHING, NOTHING, (), refused=refused))
        assert (np.abs(picture.astype(int) - REFUSED).sum(axis=2) < 80).any() == refused


@pytest.mark.parametrize("size", [(320, 240), (4000, 3000)])
def test_lines_fit_into_the_picture_and_can_be_read(size: tuple[int, int]) -> None:
    image = np.full((size[1], size[0]), 90, np.uint8)
    lines = ("front: 12 views, ep_even, RMS 0.071 px, E to 0.02 mm", "upper left, 12 cm, tilted 25°")
    request = OverlayRequest(NOTHING, NOTHING, lines, compressed=True, page=True)
    pictures = draw_pictures(image, Detection(reason="none"), request)
    assert pictures.raw is not None and pictures.compressed is not None and pictures.page is not None
    written = (pictures.raw > 150).any(axis=2)
    assert not written[:, -2:].any() and 0.25 < written.any(axis=0).mean()
    rows = np.flatnonzero(written.any(axis=1))
    assert rows.max() < 0.2 * pictures.raw.shape[0] and rows.max() > 0.04 * pictures.raw.shape[0]
    page = cv2.imdecode(np.frombuffer(pictures.page, np.uint8), cv2.IMREAD_COLOR)
    assert page.shape == pictures.raw.shape and not (page > 150).any()
    assert len(pictures.compressed) < pictures.raw.nbytes / 10


@pytest.mark.parametrize(
    ("steering", "towards"),
    [
        (Steering((0.3, 0.0), 0, ""), (500, 240)),
        (Steering((0.0, 0.0), 1, ""), (352, 272)),
        (Steering((0.0, 0.0), -1, ""), (342, 262)),
        (Steering((0.0, 0.0), 0, "right"), (370, 240)),
    ],
    ids=["move", "nearer", "farther", "tip"],
)
def test_arrows_show_which_way(steering: Steering, towards: tuple[int, int]) -> None:
    image = np.zeros((480, 640), np.uint8)
    found = Detection(np.arange(4), np.array([[270.0, 190.0], [370.0, 190.0], [370.0, 290.0], [270.0, 290.0]]))
    square = np.array([[450.0, 190.0], [550.0, 190.0], [550.0, 290.0], [450.0, 290.0]])
    plain = draw_overlay(image, found, OverlayRequest(NOTHING, square, ()))
    drawn = draw_overlay(image, found, OverlayRequest(NOTHING, square, ()), steering)
    changed = np.argwhere((plain != drawn).any(axis=2))[:, ::-1]
    assert len(changed) > 50
    assert np.linalg.norm(changed - np.array(towards), axis=1).min() < 12
