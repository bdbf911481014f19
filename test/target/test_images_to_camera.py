"""From rendered images of a circle grid to a camera: detect, calibrate, look again where it says, calibrate."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
import pytest

from fisheye_ep_calib import Observations, calibrate
from fisheye_ep_calib.simulation import Imaging, paper_camera, paper_poses, paper_target, random_poses, render

TARGET = paper_target()
RIM = np.radians(80.0)


@dataclass(frozen=True)
class Errors:
    """Of a camera at 80°: of E, mm, and of f·r, px; and the RMS, px."""

    pupil: float
    radius: float
    rms: float


def poses(count: int) -> np.ndarray:
    """The paper's 25 and others like them."""
    near = random_poses(TARGET, 11, seed=9, distance=(0.08, 0.2), theta_deg=(0, 80), tilt_deg=(0, 45))
    return np.concatenate([paper_poses(TARGET, seed=2), near])[:count]


def images(camera, count: int) -> list[np.ndarray]:
    """Views with blur, noise, vignetting, shading and a background, of their own each."""
    rng = np.random.default_rng(4)
    made = []
    for number, pose in enumerate(poses(count)):
        imaging = Imaging(
            blur=rng.uniform(0.5, 1.0), noise=1.0, vignetting=0.3, shading=rng.uniform(0, 0.2), texture=30, seed=number
        )
        made.append(render(camera, TARGET, pose, imaging))
    return made


def observed(detections, camera) -> Observations:
    views = [(number, found) for number, found in enumerate(detections) if len(found)]
    return Observations.create(
        TARGET.object_points,
        np.concatenate([np.full(len(found), number) for number, found in views]),
        np.concatenate([found.point_index for _, found in views]),
        np.concatenate([found.pixels for _, found in views]),
        camera.image_size,
        image_names=tuple(f"{number:02d}" for number in range(len(detections))),
        disc_radius=TARGET.disc_radius,
    )


def two_passes(camera, pictures, disc_centers: str) -> Errors:
    detector = TARGET.detector()
    detections = [detector.detect(picture) for picture in pictures]
    first = calibrate(observed(detections, camera), model="ep_odd", disc_centers=disc_centers)
    for view, pose in zip(first.view_images, first.camera_from_target, strict=True):
        detections[view] = detector.detect_guided(pictures[view], first.camera, pose)
    result = calibrate(observed(detections, camera), model="ep_odd", disc_centers=disc_centers)
    found = result.camera
    return Errors(
        1000 * float(found.entrance_pupil(RIM) - camera.entrance_pupil(RIM)),
        float(found.fx * found.radius(RIM) - camera.fx * camera.radius(RIM)),
        result.rms_px,
    )


@pytest.fixture(scope="module")
def small_camera():
    """The paper's camera with a quarter of the pixels."""
    camera = paper_camera()
    half = {name: getattr(camera, name) / 2 for name in ("fx", "fy", "skew")}
    return replace(camera, image_size=(1024, 1024), cx=(camera.cx - 0.5) / 2, cy=(camera.cy - 0.5) / 2, **half)


def test_a_few_small_images(small_camera):
    pictures = images(small_camera, 15)
    unbiased = two_passes(small_camera, pictures, "unbiased")
    assert abs(unbiased.pupil) < 0.02 and abs(unbiased.radius) < 0.03 and unbiased.rms < 0.01
    naive = two_passes(small_camera, pictures, "naive")
    assert abs(naive.pupil) > 0.2 and abs(naive.radius) > 0.2


@pytest.mark.slow
def test_thirty_six_images():
    camera = paper_camera()
    pictures = images(camera, 36)
    unbiased = two_passes(camera, pictures, "unbiased")
    assert abs(unbiased.pupil) <= 0.03
    assert abs(unbiased.radius) <= 0.05
    assert unbiased.rms <= 0.02
    # What the model of the discs removes: a false pupil and a false r(θ), hardly seen in the RMS.
    naive = two_passes(camera, pictures, "naive")
    assert abs(naive.pupil) > 0.2 and abs(naive.radius) > 0.4
    assert naive.rms < 0.1
