"""Where the target is in none of the images, a board of another kind that is seen in its place is named."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import cv2
import pytest
from bag_writers import messages, write_folder, write_mcap

from fisheye_ep_calib.errors import CalibrationError
from fisheye_ep_calib.pipeline import find_target
from fisheye_ep_calib.simulation import Imaging, clutter_image, look_pose, paper_camera, render
from fisheye_ep_calib.target import parse_target

SIDE = 640
WHOLE = paper_camera()
SCALE = SIDE / WHOLE.image_size[0]
CAMERA = replace(
    WHOLE, fx=SCALE * WHOLE.fx, fy=SCALE * WHOLE.fy, cx=SIDE / 2, cy=SIDE / 2, skew=0.0, image_size=(SIDE, SIDE)
)
BOARDS = {
    "chessboard": {"type": "chessboard", "columns": 7, "rows": 5, "spacing": 0.02},
    "discs": {"type": "circle_grid", "columns": 7, "rows": 5, "spacing": 0.02, "radius": 0.006},
    "charuco": {
        "type": "charuco",
        "columns": 7,
        "rows": 5,
        "spacing": 0.024,
        "marker_size": 0.018,
        "dictionary": "DICT_4X4_50",
    },
}
WORDS = {
    "chessboard": "a chessboard of 7 × 5 inner corners is seen instead",
    "discs": r"a grid of \d\d discs is seen instead",
    "charuco": "a board with markers of DICT_4X4_50 is seen instead",
}


@pytest.mark.parametrize("door", ["folder", "bag"])
@pytest.mark.parametrize(
    "shown, filed",
    [("chessboard", "discs"), ("chessboard", "charuco"), ("discs", "chessboard"), ("charuco", "chessboard")],
)
def test_another_board_is_named(tmp_path: Path, shown: str, filed: str, door: str) -> None:
    if "charuco" in (shown, filed) and not hasattr(cv2, "aruco"):
        pytest.skip("this OpenCV has no aruco")
    board = parse_target(BOARDS[shown])
    images = [
        render(CAMERA, board, look_pose(board, 0.3 * i, 0.4, 0.3, tilt=0.3), Imaging(blur=0.7, noise=2, seed=i))
        for i in range(3)
    ]
    path = write_folder(tmp_path / "a", images)
    path = write_mcap(tmp_path / "a.mcap", messages(images, "/a")) if door == "bag" else path
    with pytest.raises(CalibrationError, match=WORDS[shown]):
        find_target(path, parse_target(BOARDS[filed]), workers=1)


@pytest.mark.parametrize("filed", ["chessboard", "discs"])
def test_nothing_is_named_where_nothing_is_seen(tmp_path: Path, filed: str) -> None:
    path = write_folder(tmp_path / "a", [clutter_image(seed, (SIDE, SIDE)) for seed in range(6)])
    with pytest.raises(CalibrationError) as refused:
        find_target(path, parse_target(BOARDS[filed]), workers=1)
    assert "instead" not in str(refused.value)
