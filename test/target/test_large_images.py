"""Images of tens of megapixels: boards are found where they are, textures cost no more than boards."""

from __future__ import annotations

import time

import cv2
import numpy as np
import pytest
from known_scenes import BOARD

from fisheye_ep_calib.camera import FisheyeCamera
from fisheye_ep_calib.simulation.rendering import Imaging, render
from fisheye_ep_calib.target.corners.texture import has_corners_everywhere

CAMERA = FisheyeCamera((3600, 2700), 1100, 1100, 1800, 1350, model="ep_even", coefficients=(-0.001, 0.0))


def checks(height: int, width: int, side: int) -> np.ndarray:
    rows, columns = np.arange(height) // side, np.arange(width) // side
    return np.where((rows[:, None] + columns) % 2, 0, 255).astype(np.uint8)


@pytest.mark.parametrize("away", [0.13, 0.8])  # m: the squares are 170 and 27 px wide
def test_a_board_is_found_to_hundredths_of_a_pixel(away) -> None:
    pose = np.eye(4)
    pose[:3, :3], _ = cv2.Rodrigues(np.array([0.1, 0.3, 0.2]))
    pose[:3, 3] = -pose[:3, :3] @ BOARD.object_points.mean(axis=0) + [0.02, 0.0, away]
    detection = BOARD.detector().detect(render(CAMERA, BOARD, pose, Imaging(blur=0.7)))
    assert len(detection) == len(BOARD.object_points)
    points = BOARD.object_points[detection.point_index] @ pose[:3, :3].T + pose[:3, 3]
    expected, _ = CAMERA.project(points)
    assert np.abs(detection.pixels - expected).max() < 0.1


def test_a_texture_is_refused_soon() -> None:
    """187,500 squares: to look for a board among them takes half a minute."""
    began = time.process_time()
    assert len(BOARD.detector().detect(checks(3000, 4000, 8))) == 0
    assert time.process_time() - began < 5


def test_corners_are_counted_in_every_strip() -> None:
    image = np.full((3000, 2000), 128, np.uint8)
    assert not has_corners_everywhere(image)
    image[2000:] = checks(1000, 2000, 8)
    assert has_corners_everywhere(image)
    assert not has_corners_everywhere(checks(3000, 2000, 100))


def test_noise_is_no_texture() -> None:
    noise = np.random.default_rng(1).normal(128, 10, (3000, 2000))
    assert not has_corners_everywhere(noise.clip(0, 255).astype(np.uint8))
