"""A rendered checkerboard at 120 mm, rectified: what the entrance pupil is worth."""

from __future__ import annotations

import numpy as np
import pytest

from fisheye_ep_calib.calibration.assessing.stand_in import single_viewpoint
from fisheye_ep_calib.rectification import Rectifier, make_view
from fisheye_ep_calib.simulation import Imaging, render
from fisheye_ep_calib.target.boards.chessboard import Chessboard

DISTANCE = 0.12
COLUMNS, ROWS = 17, 13


@pytest.fixture(scope="module")
def board() -> Chessboard:
    return Chessboard.create("board", COLUMNS, ROWS, spacing=0.012)


@pytest.fixture(scope="module")
def image(lens, board) -> np.ndarray:
    """The board across the axis at 120 mm, its outer corners 45° off it."""
    pose = np.eye(4)
    pose[:2, 3] = -board.object_points.mean(axis=0)[:2]
    pose[2, 3] = DISTANCE
    return render(lens, board, pose, Imaging(blur=0.7, noise=2.0, seed=1))


def bend(board: Chessboard, image: np.ndarray) -> float:
    """RMS distance, px, of the corners found from the straight lines through each row and each column."""
    found = board.detector().detect(image)
    assert len(found) == COLUMNS * ROWS, found.reason
    square, count = 0.0, 0
    for of_point in (found.point_index % COLUMNS, found.point_index // COLUMNS):
        for line in np.unique(of_point):
            points = found.pixels[of_point == line]
            spread = np.linalg.svd(points - points.mean(axis=0), compute_uv=False)
            square, count = square + spread[1] ** 2, count + len(points)
    return float(np.sqrt(square / count))


def test_straight_lines_are_straight_with_the_pupil(board, image, calibrated, calibrated_without_pupil, capsys) -> None:
    cameras = {
        "entrance pupil": calibrated.camera,
        "stand-in of the same file": calibrated.stand_in.camera,
        "stand-in made for 120 mm": single_viewpoint(calibrated.camera, DISTANCE).camera,
        "calibrated without pupil": calibrated_without_pupil,
    }
    view = make_view(calibrated.camera)
    bends = {name: bend(board, Rectifier(camera, view).rectify(image, DISTANCE)) for name, camera in cameras.items()}
    with capsys.disabled():
        print("\nRMS off the straight line, checkerboard at 120 mm:")
        for name, value in bends.items():
            print(f"  {name:<28}{value:.3f} px")
    with_pupil = bends.pop("entrance pupil")
    assert with_pupil <= 0.2
    assert min(bends.values()) > 5 * with_pupil
