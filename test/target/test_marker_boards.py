"""Boards of markers that are not quite what their file says: taken as they are where that is certain, else named."""

from __future__ import annotations

import re
from dataclasses import replace

import cv2
import numpy as np
import pytest

from fisheye_ep_calib.simulation import Imaging, clutter_image, feature_pixels, look_pose, paper_camera, render
from fisheye_ep_calib.target import parse_target
from fisheye_ep_calib.target.base import Artwork
from fisheye_ep_calib.target.boards.aprilgrid import AprilGrid
from fisheye_ep_calib.target.boards.charuco import Charuco
from fisheye_ep_calib.target.markers.aruco import bits_as_quads
from fisheye_ep_calib.target.markers.codebook import codebook, read_cells

pytestmark = pytest.mark.skipif(not hasattr(cv2, "aruco"), reason="this OpenCV has no aruco")

CAMERA = paper_camera()
APRIL = AprilGrid.create("tags", 6, 4, 0.02, 0.006)
CHARUCO = Charuco.create("board", 9, 5, 0.016, 0.012, "DICT_5X5_100")


def seen(target, distance=0.15, roll=0.4, theta=0.5, **imaging):
    """An image of a target, and where its features are."""
    pose = look_pose(target, theta, 0.4, distance, tilt=0.3, roll=roll)
    image = render(CAMERA, target, pose, Imaging(blur=0.7, noise=2, texture=20, **imaging))
    return image, feature_pixels(CAMERA, target, pose)[0]


class TurnedTags(AprilGrid):
    """Tags turned by half a turn within their cells, as OpenCV draws them."""

    def artwork(self) -> Artwork:
        bits = self.tag_bits[:, ::-1, ::-1]
        cell = self.tag_size / bits.shape[1]
        upright = super().artwork()
        squares = upright.quads[-(self.columns + 1) * (self.rows + 1) :]
        tags = bits_as_quads(bits, self.tag_corners, np.array([cell, 0]), np.array([0, cell]))
        return replace(upright, quads=np.concatenate([tags, squares]))


def right(found, truth) -> bool:
    return bool(np.linalg.norm(found.pixels - truth[found.point_index], axis=1).max() < 1)


@pytest.mark.parametrize("target", [APRIL, CHARUCO], ids=["aprilgrid", "charuco"])
def test_negatives_are_found(target):
    image, truth = seen(target, black=225, white=30)
    found = target.detector().detect(image)
    assert len(found) >= 0.97 * len(truth)
    assert right(found, truth)


def test_tags_turned_within_their_cells_are_named_and_rightly_labelled():
    printed = TurnedTags.create("turned", 6, 4, 0.02, 0.006)
    printed = TurnedTags(**{name: getattr(printed, name) for name in printed.__dataclass_fields__})
    for roll in (0.3, 2.4):
        image, truth = seen(printed, roll=roll)
        found = APRIL.detector().detect(image)
        assert len(found) >= 0.97 * len(truth)
        assert right(found, truth)
        assert "turned by 180°" in found.remark


@pytest.mark.parametrize("legacy", [False, True])
@pytest.mark.parametrize("columns", [9, 10])
def test_the_other_layout_of_charuco_is_tried(legacy, columns):
    """Of 11 squares a row both layouts put nearly all markers alike, but one column further."""
    printed = CHARUCO.laid_out(columns, 5, legacy)
    image, truth = seen(printed)
    detector = printed.laid_out(columns, 5, not legacy).detector()
    found = detector.detect(image)
    assert len(found) >= 0.95 * len(truth)
    assert right(found, truth)
    assert f"legacy: {str(legacy).lower()}" in found.remark
    assert printed.detector().detect(image).remark == ""
    again = detector.detect_guided(image, CAMERA, look_pose(printed, 0.5, 0.4, 0.15, tilt=0.3, roll=0.4), found)
    assert len(again) >= 0.95 * len(truth) and right(again, truth)


@pytest.mark.parametrize(
    "printed, filed, words",
    [
        (replace(APRIL, first_tag=48), APRIL, "markers 48 to 71 are seen.*0 to 23: check first_tag: 48"),
        (AprilGrid.create("t", 4, 6, 0.02, 0.006), APRIL, "fit columns: 4, rows: 6"),
        (AprilGrid.create("t", 5, 5, 0.02, 0.006), APRIL, "do not lie as the target file says"),
        (Charuco.create("c", 5, 9, 0.016, 0.012, "DICT_5X5_100"), CHARUCO, "fit columns: 5, rows: 9"),
        (replace(CHARUCO, dictionary="DICT_4X4_50"), CHARUCO, "markers of DICT_4X4_50 are seen, not of DICT_5X5_100"),
        (replace(CHARUCO, dictionary="DICT_APRILTAG_36h11"), CHARUCO, "markers of DICT_APRILTAG_36h11 are seen"),
        (CHARUCO, APRIL, "markers of DICT_5X5_50 are seen, not of DICT_APRILTAG_36h11 with a border of 2 cells"),
    ],
    ids=["first-tag", "swapped-tags", "other-count", "swapped-squares", "dictionary", "family", "other-kind"],
)  # fmt: skip
def test_what_does_not_fit_the_file_is_named(printed, filed, words):
    found = filed.detector().detect(seen(printed)[0])
    assert len(found) == 0
    assert re.search(words, found.reason), found.reason


@pytest.mark.parametrize("target", [APRIL, CHARUCO], ids=["aprilgrid", "charuco"])
def test_a_mirrored_image_is_named(target):
    found = target.detector().detect(np.ascontiguousarray(seen(target)[0][:, ::-1]))
    assert len(found) == 0
    assert "mirrored" in found.reason


@pytest.mark.parametrize("target", [APRIL, CHARUCO], ids=["aprilgrid", "charuco"])
def test_of_two_copies_the_more_complete_one_is_taken(target):
    left, truth = seen(target, distance=0.22, theta=0.7, roll=0.1)
    right_pose = look_pose(target, 0.7, 0.4 + np.pi, 0.22, tilt=0.3, roll=0.5)
    other = render(CAMERA, target, right_pose, Imaging(blur=0.7, noise=2, texture=20))
    middle = np.median(feature_pixels(CAMERA, target, right_pose)[0], axis=0)
    low, high = truth.min(axis=0).astype(int) - 60, truth.max(axis=0).astype(int) + 60
    both = other.copy()
    both[low[1] : high[1], low[0] : high[0]] = left[low[1] : high[1], low[0] : high[0]]
    # Half of the other copy is hidden.
    both[:, int(middle[0]) : int(middle[0]) + 500] = 120
    found = target.detector().detect(both)
    assert len(found) >= 0.95 * len(truth)
    assert right(found, truth)
    assert "another board with the same markers is in view" in found.remark


def test_no_marker_is_read_from_clutter():
    for number in range(4):
        found = APRIL.detector().detect(clutter_image(number))
        assert len(found) == 0 and found.reason


@pytest.mark.parametrize("name", ["DICT_4X4_50", "DICT_APRILTAG_36h11"])
@pytest.mark.parametrize("turn", range(4))
def test_cells_are_read_and_matched_in_every_turn(name, turn):
    book = codebook(name, 1, "a test")
    number = 7
    side = book.side
    picture = np.zeros((side, side), np.uint8)
    picture[1:-1, 1:-1] = np.rot90(book.codes[number], -turn) * 255
    image = np.pad(np.kron(picture, np.ones((8, 8), np.uint8)), 20, constant_values=255)
    low, high = 19.5, 19.5 + 8 * side
    quad = np.array([[[low, low], [high, low], [high, high], [low, high]]])
    cells, framed = read_cells(image, quad, side - 2, 1)
    assert framed.all()
    assert [int(found[0]) for found in book.match(cells)] == [number, turn, 0]
    assert book.match(cells[:, :, ::-1])[0][0] != number
    assert book.match(cells[:, :, ::-1], mirrored=True)[0][0] == number


def test_a_board_of_one_tag_needs_no_neighbour():
    target = parse_target({"type": "aprilgrid", "columns": 1, "rows": 1, "tag_size": 0.06, "tag_gap": 0.02})
    image, truth = seen(target)
    found = target.detector().detect(image)
    assert len(found) == 4 and right(found, truth)


def test_a_mirrored_board_of_a_small_dictionary() -> None:
    """Three of its markers are others in a mirror, and lie as these should."""
    board = Charuco.create("board", 7, 5, 0.024, 0.018, "DICT_4X4_50")
    image, _ = seen(board, distance=0.3, roll=2.0)
    found = board.detector().detect(np.ascontiguousarray(image[:, ::-1]))
    assert len(found) == 0 and "mirrored" in found.reason
