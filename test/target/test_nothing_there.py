"""Images without a target: nothing is found, nothing is raised, and it does not take long."""

from __future__ import annotations

import time
from pathlib import Path

import cv2
import numpy as np
import pytest

from fisheye_ep_calib.simulation.clutter import clutter_image
from fisheye_ep_calib.target import load_target
from fisheye_ep_calib.target.what_else import what_else

SHIPPED = sorted((Path(__file__).resolve().parents[2] / "config" / "targets").glob("*.yaml"))
LONGEST = 20.0


def hostile_images() -> dict[str, np.ndarray]:
    rng = np.random.default_rng(1)
    noise = rng.normal(128, 40, (1024, 1024)).clip(0, 255).astype(np.uint8)
    dots = 255 - cv2.dilate(
        (rng.random((1024, 1024)) > 0.999).astype(np.uint8) * 255,
        cv2.getStructuringElement(cv2.MORPH_ELLIPSE, (9, 9)),
    )
    y, x = np.mgrid[:1024, :1024]
    return {
        "empty": np.zeros((0, 0), np.uint8),
        "no columns": np.zeros((5, 0), np.uint8),
        "one pixel": np.zeros((1, 1), np.uint8),
        "strip": rng.integers(0, 256, (3, 200)).astype(np.uint8),
        "small": rng.integers(0, 256, (17, 23)).astype(np.uint8),
        "black": np.zeros((2048, 2048), np.uint8),
        "saturated": np.full((2048, 2048), 255, np.uint8),
        "wide": rng.integers(0, 256, (100, 30000)).astype(np.uint8),
        "noise": noise,
        "speckle": rng.integers(0, 256, (1024, 1024)).astype(np.uint8),
        "random dots": dots,
        "stripes": ((x // 20) % 2 * 255).astype(np.uint8),
        "grille": (((x // 20) % 2) * ((y // 20) % 2) * 255).astype(np.uint8),
    }


@pytest.fixture(params=SHIPPED, ids=lambda path: path.stem)
def detector(request):
    target = load_target(request.param)
    if target.kind in ("charuco", "aprilgrid") and not hasattr(cv2, "aruco"):
        pytest.skip("this OpenCV has no aruco")
    return target.detector()


def test_hostile_images(detector):
    for name, image in hostile_images().items():
        start = time.process_time()
        detection = detector.detect(image)
        assert len(detection) == 0, name
        assert detection.reason, name
        assert time.process_time() - start < LONGEST, name


def test_hostile_images_where_a_board_is_expected(detector):
    from fisheye_ep_calib.simulation import look_pose, paper_camera

    camera = paper_camera()
    pose = look_pose(detector.target, 0.2, 0.3, 0.15)
    for name, image in hostile_images().items():
        if name != "strip":
            assert len(detector.detect_guided(image, camera, pose)) <= 2, name


def test_nothing_but_a_little_noise(detector):
    rng = np.random.default_rng(3)
    for level, noise in ((3, 0.6), (10, 1.5), (60, 4)):
        image = rng.normal(level, noise, (600, 800)).round().clip(0, 255).astype(np.uint8)
        assert len(detector.detect(image)) == 0, (level, noise)
    for seed in range(3):
        assert len(detector.detect(clutter_image(seed) // 12)) == 0, seed


def test_clutter(detector):
    for seed in range(12):
        assert len(detector.detect(clutter_image(seed))) == 0, seed


@pytest.mark.slow
def test_much_clutter(detector):
    for seed in range(200):
        assert len(detector.detect(clutter_image(seed))) == 0, seed


def test_wrong_kinds_of_array(detector):
    assert detector.detect(np.zeros((50, 50, 3), np.uint8)).reason
    assert detector.detect(np.zeros((50, 50), np.float32)).reason


NARROW = [(1, 2000), (15, 900), (16, 1024), (16, 5000), (17, 1101), (40, 2560)]


@pytest.mark.parametrize("shape", NARROW, ids=str)
def test_nothing_is_in_narrow_images_and_no_other_board_either(detector, shape):
    rng = np.random.default_rng(2)
    bars = np.tile(np.repeat(np.uint8([0, 255]), 4), (shape[0], shape[1] // 8 + 1))[:, : shape[1]].copy()
    for image in (rng.integers(0, 256, shape).astype(np.uint8), bars):
        for turned in (image, image.T.copy()):
            assert len(detector.detect(turned)) == 0
            assert what_else(turned, detector.target) == ""
