"""Two boards of one kind in view: one is read, whole and by itself, and the other named."""

from __future__ import annotations

import cv2
import numpy as np
import pytest

from fisheye_ep_calib.simulation import Imaging, feature_pixels, look_pose, paper_camera, render
from fisheye_ep_calib.target import Target, parse_target
from fisheye_ep_calib.target.another_board import ANOTHER

CAMERA = paper_camera()
IMAGING = Imaging(blur=0.8, noise=2, texture=30)
BOARDS = {
    "chessboard": parse_target({"type": "chessboard", "columns": 9, "rows": 6, "spacing": 0.012}),
    "discs": parse_target({"type": "circle_grid", "columns": 11, "rows": 7, "spacing": 0.012, "radius": 0.004}),
    "asymmetric": parse_target(
        {"type": "circle_grid", "columns": 4, "rows": 9, "spacing": 0.012, "radius": 0.004, "asymmetric": True}
    ),
}


def outline(target: Target, pose: np.ndarray) -> np.ndarray:
    """Pixels around the whole print."""
    low, high = target.artwork().low, target.artwork().high
    corners = np.array([low, [high[0], low[1]], high, [low[0], high[1]], low])
    edges = np.concatenate([np.linspace(start, end, 40) for start, end in zip(corners[:-1], corners[1:], strict=True)])
    pixels, _ = CAMERA.project(np.pad(edges, ((0, 0), (0, 1))) @ pose[:3, :3].T + pose[:3, 3])
    return np.rint(pixels).astype(np.int32)


def both(target: Target, behind: np.ndarray, before: np.ndarray) -> np.ndarray:
    """An image of two boards, the second before the first."""
    image, front = (render(CAMERA, target, pose, IMAGING) for pose in (behind, before))
    mask = np.zeros(image.shape, np.uint8)
    cv2.fillPoly(mask, [outline(target, before)], 255)
    return np.where(mask > 0, front, image)


def of_one_board(found, target: Target, poses: list[np.ndarray]) -> int:
    """Of which board all points are."""
    own = []
    for pose in poses:
        apart = np.linalg.norm(found.pixels[:, None] - feature_pixels(CAMERA, target, pose)[0], axis=2).min(axis=1)
        own.append(bool((apart < 2).all()))
    assert sum(own) == 1
    return own.index(True)


@pytest.mark.parametrize("kind", BOARDS)
@pytest.mark.parametrize("larger", [0, 1])
def test_the_larger_of_two_whole_boards(kind: str, larger: int) -> None:
    target = BOARDS[kind]
    away = (0.16, 0.24) if larger == 0 else (0.24, 0.16)
    poses = [
        look_pose(target, 0.5, azimuth, distance, tilt=0.3, roll=azimuth)
        for azimuth, distance in zip((0.2, 3.3), away, strict=True)
    ]
    found = target.detector().detect(both(target, *poses))
    assert len(found) == len(target.object_points) and ANOTHER in found.remark
    assert of_one_board(found, target, poses) == larger


@pytest.mark.parametrize("kind", BOARDS)
def test_the_more_complete_of_two_boards_side_by_side(kind: str) -> None:
    """The right one lies before the left one's last columns, in the same plane and nearly in line."""
    target = BOARDS[kind]
    left = look_pose(target, 0.35, 3.1, 0.22, tilt=0.3)
    right = left.copy()
    width = (target.artwork().high - target.artwork().low)[0]
    right[:3, 3] = left[:3, 3] + left[:3, :3] @ [0.8 * width, 0.001, 0]
    found = target.detector().detect(both(target, left, right))
    assert len(found) == len(target.object_points) and ANOTHER in found.remark
    assert of_one_board(found, target, [left, right]) == 1


@pytest.mark.parametrize("kind", BOARDS)
def test_one_board_is_no_two(kind: str) -> None:
    target = BOARDS[kind]
    found = target.detector().detect(render(CAMERA, target, look_pose(target, 0.5, 0.2, 0.16, tilt=0.3), IMAGING))
    assert len(found) == len(target.object_points) and found.remark == ""
