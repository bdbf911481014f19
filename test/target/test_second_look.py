"""What the first look found stays in the second one, unless the image contradicts it; then it is said why."""

from __future__ import annotations

from dataclasses import replace

import cv2
import numpy as np
import pytest
from scipy.interpolate import RBFInterpolator

from fisheye_ep_calib.simulation import Imaging, feature_pixels, look_pose, paper_camera, render
from fisheye_ep_calib.target import Detection, Target, load_target
from fisheye_ep_calib.target.second_look import DOUBLED, look_again

CAMERA = replace(
    paper_camera(),
    image_size=(1024, 1024),
    **{name: getattr(paper_camera(), name) / 2 for name in ("fx", "fy", "cx", "cy")},
)
TARGETS = ["circle_grid_11x7", "chessboard_9x6", "charuco_10x7", "aprilgrid_6x5"]


def seen(name: str) -> tuple[Target, np.ndarray, np.ndarray, Detection]:
    """A target, an image of it, its pose, and what a first look would find if it knew the names of all."""
    target = load_target(name)
    diagonal = float(np.hypot(*np.ptp(target.object_points[:, :2], axis=0)))
    pose = look_pose(target, 0.6, 0.7, 0.8 * diagonal, 0.3, 1.0, 0.3)
    image = render(CAMERA, target, pose, Imaging(blur=0.7, noise=1))
    truth, _ = feature_pixels(CAMERA, target, pose)
    return target, image, pose, Detection(np.arange(len(truth)), truth)


def curled(target: Target) -> np.ndarray:
    """How far each point (n, 2), px, is off where a flat board would have it: one corner of the paper is lifted."""
    away = np.linalg.norm(target.object_points[:, :2] - target.object_points[0, :2], axis=1)
    most = 0.15 if target.disc_radius else 0.6
    step = np.ptp(target.object_points[:, 0]) / 10
    return most * np.exp(-((away / step) ** 2))[:, None] * np.array([[0.8, 0.6]])


@pytest.mark.parametrize("name", TARGETS)
def test_a_board_whose_corner_curls_keeps_its_points(name: str) -> None:
    """The camera expects a flat board; points that lie off by more than is common are there all the same."""
    target, image, pose, first = seen(name)
    detector = target.detector()
    assert len(look_again(detector, image, CAMERA, pose, first)) == len(first)
    warp = _as_image(first.pixels, curled(target), image.shape)
    rows, columns = np.indices(image.shape, dtype=np.float32)
    image = cv2.remap(image, columns - warp[..., 0], rows - warp[..., 1], cv2.INTER_CUBIC)
    first = replace(first, pixels=first.pixels + curled(target))
    again = look_again(detector, image, CAMERA, pose, first)
    assert len(again) == len(first) and not again.given_up
    assert np.abs(again.pixels - first.pixels).max() < 0.2
    alone = detector.detect_guided(image, CAMERA, pose)
    assert 0 not in alone.point_index, "what is expected nowhere near is no point by itself"


@pytest.mark.parametrize("name", TARGETS)
def test_what_the_image_contradicts_is_given_up_and_said(name: str) -> None:
    target, image, pose, first = seen(name)
    first = replace(first, remark="told before")
    middle = len(first) // 2
    x, y = np.rint(first.pixels[middle]).astype(int)
    covered = image.copy()
    covered[y - 7 : y + 2, x - 7 : x + 8] = 128
    pixels = first.pixels.copy()
    pixels[0] += [1.6, 1.2]  # its neighbours' looks are not concerned
    again = look_again(target.detector(), covered, CAMERA, pose, replace(first, pixels=pixels))
    assert again.given_up[middle].startswith("blurred or") and again.given_up[0] == "moved by more than 1 px"
    assert not np.isin([0, middle], again.point_index).any() and again.remark == "told before"
    near = np.hypot(*(first.pixels - first.pixels[middle]).T) < 25
    assert all(near[point] or point == 0 for point in again.given_up)
    assert len(again) + len(again.given_up) == len(first)


class Forgetful:
    """A detector of another package: it is told nothing of the first look, and finds but every second point."""

    def detect_guided(self, image, camera, camera_from_target):
        return Detection(np.array([0, 2]), np.array([[10.0, 10.0], [30.0, 10.0]]))


class Blind:
    def detect_guided(self, image, camera, camera_from_target, first=None):
        return Detection(reason="board out of view")


def test_points_that_a_detector_says_nothing_of_stay() -> None:
    first = Detection(np.array([3, 1, 2]), np.array([[30.2, 10.1], [20.0, 10.0], [29.0, 11.0]]))
    again = look_again(Forgetful(), np.zeros((40, 40), np.uint8), CAMERA, np.eye(4), first)
    assert again.point_index.tolist() == [0, 1, 2] and again.given_up == {3: DOUBLED}
    assert again.pixels.tolist() == [[10.0, 10.0], [20.0, 10.0], [30.0, 10.0]]
    assert look_again(Blind(), np.zeros((40, 40), np.uint8), CAMERA, np.eye(4), first) is first


def _as_image(at: np.ndarray, values: np.ndarray, shape: tuple[int, ...]) -> np.ndarray:
    """A smooth field (h, w, 2) with such values (n, 2) about such pixels (n, 2)."""
    rows, columns = np.indices((shape[0] // 8, shape[1] // 8)) * 8.0
    field = RBFInterpolator(at, values, neighbors=24, smoothing=0.0)(np.column_stack([columns.ravel(), rows.ravel()]))
    return cv2.resize(field.reshape(*rows.shape, 2).astype(np.float32), shape[::-1], interpolation=cv2.INTER_LINEAR)
