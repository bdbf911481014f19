"""An image without a detection says why, in words a user understands."""

from __future__ import annotations

import cv2
import numpy as np
import pytest
from scipy.spatial import cKDTree

from fisheye_ep_calib.rotation import rotation_from_vector
from fisheye_ep_calib.simulation import Imaging, look_pose, paper_camera, paper_target, render
from fisheye_ep_calib.simulation.clutter import clutter_image
from fisheye_ep_calib.target import parse_target
from fisheye_ep_calib.target.sharpness import edge_blur

CAMERA, DISCS = paper_camera(), paper_target()
HOLED = parse_target(
    {
        "type": "circle_grid",
        "columns": 11,
        "rows": 7,
        "spacing": 0.012,
        "radius": 0.004,
        "holed": [[5, 3], [6, 3], [5, 2]],
    }
)
BOARDS = {
    "circle_grid": DISCS,
    "chessboard": parse_target({"type": "chessboard", "columns": 9, "rows": 6, "spacing": 0.012}),
    "aprilgrid": parse_target({"type": "aprilgrid", "columns": 5, "rows": 4, "tag_size": 0.02, "tag_gap": 0.006}),
    "charuco": parse_target({"type": "charuco", "columns": 9, "rows": 6, "spacing": 0.016, "marker_size": 0.012}),
}


@pytest.fixture(params=BOARDS)
def board(request):
    if request.param in ("charuco", "aprilgrid") and not hasattr(cv2, "aruco"):
        pytest.skip("this OpenCV has no aruco")
    return BOARDS[request.param]


@pytest.mark.parametrize("sigma", [1.0, 3.0, 8.0, 15.0])
@pytest.mark.parametrize("noise", [0.0, 8.0])
def test_blur_is_measured(sigma, noise):
    image = render(CAMERA, DISCS, look_pose(DISCS, 0.3, 0.4, 0.1), Imaging(blur=sigma, noise=noise, texture=30))
    assert 0.5 * sigma - 0.5 < edge_blur(image) < 1.3 * sigma + 1.0


def test_a_blurred_board(board):
    image = render(CAMERA, board, look_pose(board, 0.3, 0.4, 0.35), Imaging(blur=18, noise=2, texture=30))
    detection = board.detector().detect(image)
    assert len(detection) == 0
    assert detection.reason.startswith("blurred by about ")


def test_no_board(board):
    detection = board.detector().detect(clutter_image(3))
    assert len(detection) == 0 and detection.reason == "board not found"


def test_candidates_are_shown_where_no_board_is_found():
    assert len(DISCS.detector().detect(clutter_image(0)).rejected) > 5


def test_a_board_of_which_too_little_is_seen():
    pose = look_pose(DISCS, 0.1, 0.4, 0.1)
    truth = render(CAMERA, DISCS, pose)
    seen = DISCS.detector().detect(truth)
    # All but a patch of 2 × 3 discs is hidden.
    patch = np.isin(seen.point_index, [24, 25, 26, 35, 36, 37])
    low, high = seen.pixels[patch].min(axis=0) - 38, seen.pixels[patch].max(axis=0) + 38
    image = np.full_like(truth, 90)
    (left, top), (right, bottom) = low.astype(int), high.astype(int)
    image[top:bottom, left:right] = truth[top:bottom, left:right]
    detection = DISCS.detector().detect(image)
    assert len(detection) == 0 and detection.reason == "6 of 77 discs"


def test_a_board_whose_marks_are_hidden_is_not_guessed():
    target = HOLED
    pose = look_pose(target, 0.2, 0.4, 0.12, tilt=0.3)
    seen = target.detector().detect(render(CAMERA, target, pose, Imaging(blur=0.8, noise=2)))
    assert len(seen) == 77
    middle = seen.pixels[np.isin(seen.point_index, target.holed)].mean(axis=0)
    patch = middle + 75 * np.array([[-1, -1], [1, -1], [1, 1], [-1, 1]])
    hidden = render(CAMERA, target, pose, Imaging(blur=0.8, noise=2, occluders=(patch,)))
    detection = target.detector().detect(hidden)
    assert len(detection) == 0 and "discs, but not which" in detection.reason


def _outline(pose, top: float, bottom: float) -> np.ndarray:
    """Pixels (k, 2) around what lies between two rows of the board's plane, metres, to its left and right too."""
    corners = np.array([[-0.04, top], [0.16, top], [0.16, bottom], [-0.04, bottom], [-0.04, top]])
    edges = [np.linspace(start, end, 20) for start, end in zip(corners[:-1], corners[1:], strict=True)]
    points = np.pad(np.concatenate(edges), ((0, 0), (0, 1)))
    return CAMERA.project(points @ pose[:3, :3].T + pose[:3, 3])[0]


def test_a_sheet_of_paper_over_the_marks_is_not_taken_for_plain_board():
    target = HOLED
    pose = look_pose(target, 0.2, 0.4, 0.12, tilt=0.3)
    # A sheet as white as the board covers all but the last three rows and lies over the board's edge; beyond the last
    # row the board ends.
    sheet = _outline(pose, -0.04, 3.5 * 0.012)
    image = render(CAMERA, target, pose, Imaging(blur=0.8, noise=2, occluders=(sheet,), occluder=225))
    cv2.fillPoly(image, [np.rint(_outline(pose, 6 * 0.012 + 0.008, 0.112)).astype(np.int32)], 90)
    detection = target.detector().detect(image)
    assert len(detection) == 0
    assert detection.reason == "33 discs, but not which: too few of the holed ones are seen"


@pytest.mark.parametrize(
    ("holed", "unmistakable"),
    [
        ([[0, 0], [2, 2], [4, 4]], False),
        ([[2, 2]], False),
        ([[1, 1]], True),
        ([[2, 2], [3, 2], [2, 1]], True),
        ([], False),
    ],
)
def test_a_board_that_keeps_its_holes_when_turned_is_found_but_not_unmistakable(holed, unmistakable):
    target = parse_target(
        {"type": "circle_grid", "columns": 5, "rows": 5, "spacing": 0.012, "radius": 0.004, "holed": holed}
    )
    assert target.unmistakable == unmistakable
    points = target.object_points
    tree, middle = cKDTree(points), points.mean(axis=0)
    turns = [rotation_from_vector(np.array([0, 0, quarters * np.pi / 2])) for quarters in range(4)]
    names = [tree.query((points - middle) @ turn.T + middle)[1] for turn in turns]
    for roll in (0.3, 2.0, 4.0):
        pose = look_pose(target, 0.2, 0.4, 0.12, tilt=0.3, roll=roll)
        seen = target.detector().detect(render(CAMERA, target, pose, Imaging(blur=0.8, noise=2)))
        assert len(seen) == 25
        pixels, _ = CAMERA.project(points @ pose[:3, :3].T + pose[:3, 3])
        right = [np.abs(pixels[name][seen.point_index] - seen.pixels).max() < 1 for name in names]
        assert sum(right) == 1
        assert set(names[right.index(True)][list(target.holed)]) == set(target.holed)
        assert right[0] or not unmistakable


def test_a_mirrored_image_of_a_holed_grid_is_named():
    pose = look_pose(HOLED, 0.3, 0.4, 0.13, tilt=0.3)
    image = render(CAMERA, HOLED, pose, Imaging(blur=0.8, noise=2))
    found = HOLED.detector().detect(np.ascontiguousarray(image[:, ::-1]))
    assert len(found) == 0
    assert "the image is mirrored" in found.reason


@pytest.mark.parametrize("radius", [0.002, 0.0033, 0.0047, 0.0054])
@pytest.mark.parametrize("negative", [False, True])
def test_a_grid_of_another_radius_is_named(radius, negative):
    """The file has 4 mm; the message says what would fit."""
    printed = parse_target({"type": "circle_grid", "columns": 11, "rows": 7, "spacing": 0.012, "radius": radius})
    black, white = (225, 30) if negative else (30, 225)
    image = render(
        CAMERA, printed, look_pose(printed, 0.3, 0.4, 0.13, tilt=0.3), Imaging(blur=0.8, black=black, white=white)
    )
    found = DISCS.detector().detect(image)
    assert len(found) == 0 and "check radius" in found.reason
    said = float(found.reason.split("(")[1].split(" m")[0])
    assert said == pytest.approx(radius, rel=0.03)


@pytest.mark.parametrize("counts", [(8, 5), (8, 6), (9, 5), (5, 8)])
@pytest.mark.parametrize("tilt", [0.1, 0.6])
def test_a_chessboard_with_more_corners_than_its_file(counts: tuple[int, int], tilt: float) -> None:
    image = render(CAMERA, BOARDS["chessboard"], look_pose(BOARDS["chessboard"], tilt, 0.4, 0.25), Imaging(noise=2))
    keys = {"type": "chessboard", "columns": counts[0], "rows": counts[1], "spacing": 0.012}
    detection = parse_target(keys).detector().detect(image)
    wide, high = sorted(counts, reverse=True)
    assert f"9 × 6 corners are seen, more than the target file's {wide} × {high}" in detection.remark


@pytest.mark.parametrize("counts", [(9, 6), (6, 9)])
@pytest.mark.parametrize("away", [0.08, 0.25])
def test_nothing_is_remarked_of_a_chessboard_as_its_file_has_it(counts: tuple[int, int], away: float) -> None:
    """Either way round, whole or in part."""
    image = render(CAMERA, BOARDS["chessboard"], look_pose(BOARDS["chessboard"], 0.3, 0.4, away), Imaging(noise=2))
    keys = {"type": "chessboard", "columns": counts[0], "rows": counts[1], "spacing": 0.012}
    detection = parse_target(keys).detector().detect(image)
    assert len(detection) and detection.remark == ""


@pytest.mark.parametrize("counts, said", [((10, 6), True), ((10, 7), True), ((11, 7), False), ((7, 11), False)])
@pytest.mark.parametrize("away", [0.1, 0.25])
def test_a_grid_with_more_discs_than_its_file(counts: tuple[int, int], said: bool, away: float) -> None:
    keys = {"type": "circle_grid", "columns": 11, "rows": 7, "spacing": 0.012, "radius": 0.004}
    board = parse_target(keys)
    image = render(CAMERA, board, look_pose(board, 0.3, 0.4, away), Imaging(noise=2))
    file = parse_target(keys | {"columns": counts[0], "rows": counts[1]})
    detection = file.detector().detect(image)
    assert len(detection) > 0
    assert detection.remark.startswith("the grid goes on: ") == said
