"""Someone who sees the outline alone is led to a known pupil: other lenses and boards than the one of the page's test.

No DDS, and one image at a time: what is asked for can be seen, few views are enough, and nothing stays open.
"""

from __future__ import annotations

import time
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from nobody import Nobody
from simulated_person import STEPS, SimulatedPerson

from fisheye_ep_calib.calibration import Observations, calibrate
from fisheye_ep_calib.camera import FisheyeCamera
from fisheye_ep_calib.camera.bands import entrance_pupil_band
from fisheye_ep_calib.live.announcer import Announcer
from fisheye_ep_calib.live.calibrator import LiveCalibrator
from fisheye_ep_calib.live.settings import CameraSettings, Settings, Tuning
from fisheye_ep_calib.live.status import Reception
from fisheye_ep_calib.simulation import random_poses
from fisheye_ep_calib.simulation.rendering import Imaging, render
from fisheye_ep_calib.target import Target, parse_target

pytestmark = [pytest.mark.slow, pytest.mark.timeout(1800)]

MOST_VIEWS = 90
PATIENCE = 60.0  # seconds for one image to be looked at


def lens(size: tuple[int, int], focal: float, half_field_deg: float, pupil: tuple[float, float]) -> FisheyeCamera:
    return FisheyeCamera(
        image_size=size,
        fx=focal,
        fy=1.003 * focal,
        cx=size[0] / 2 + 4.2,
        cy=size[1] / 2 - 3.1,
        radial=(0.012, -0.003, 0.0004, 0.0),
        model="ep_even",
        coefficients=pupil,
        theta_max=np.radians(half_field_deg),
    )


NARROW = lens((960, 720), 573.0, 61, (-0.5e-3, -0.1e-3))
WIDE = lens((1000, 1000), 296.0, 96, (-0.7e-3, -0.15e-3))
CHARUCO: dict[str, Any] = {"type": "charuco", "dictionary": "DICT_4X4_50"}
BOARDS: dict[str, dict[str, Any]] = {
    "circles": {"type": "circle_grid", "columns": 11, "rows": 7, "spacing": 0.012, "radius": 0.004},
    "chessboard": {"type": "chessboard", "columns": 10, "rows": 7, "spacing": 0.012},
    "charuco": {**CHARUCO, "columns": 7, "rows": 5, "spacing": 0.02, "marker_size": 0.015},
    "aprilgrid": {"type": "aprilgrid", "columns": 4, "rows": 3, "tag_size": 0.03, "tag_gap": 0.009},
}
SCENES = {
    f"{name}, {field}°": (camera, keys)
    for name, keys in BOARDS.items()
    for field, camera in ((120, NARROW), (190, WIDE))
}


def imaging(number: int) -> Imaging:
    return Imaging(blur=0.7, noise=2.0, texture=40.0, vignetting=0.3, seed=number)


def message(image: np.ndarray) -> SimpleNamespace:
    height, width = image.shape
    header = SimpleNamespace(frame_id="front")
    return SimpleNamespace(
        header=header, height=height, width=width, encoding="mono8", is_bigendian=0, step=width, data=image.tobytes()
    )


class Walk:
    """One person before one camera, until nothing more is asked for."""

    def __init__(self, camera: FisheyeCamera, target: Target, folder: Path, model: str) -> None:
        self.camera, self.target = camera, target
        settings = CameraSettings("front", "/front/image_raw", False, target, model, None, "", "")
        self.live = LiveCalibrator(
            Settings((settings,), folder, resume=False, workers=2), Tuning(), Announcer(print, print), Nobody()
        )
        self.person = SimulatedPerson(camera, target, seed=3)
        self.shares: dict[bytes, list[float]] = {}  # of each pose that was asked for: points found on its arrivals
        self.views: list[int] = []  # how many were kept when each of those was arrived at
        self.images = 0

    def status(self) -> dict[str, Any]:
        (status,) = self.live.status({"front": Reception("/front/image_raw", False, 0.0, 0.0)})
        return status.as_dict()

    def step(self) -> dict[str, Any]:
        """The person looks, moves, and the image is looked at."""
        subject = self.live.cameras["front"]
        while subject.guide.wanted is None and subject._busy:  # people are slower than a calibration, this loop is not
            time.sleep(0.02)
        status = self.status()
        wanted = status["wanted"]
        self.person.look(None if wanted is None else wanted["outline_px"])
        pose = self.person.move()
        looks = self.live.cameras["front"].looks
        before = looks.last.number
        self.images += 1
        self.live.offer(
            "front", message(render(self.camera, self.target, pose, imaging(self.images))), f"{self.images}.0"
        )
        give_up = time.monotonic() + PATIENCE
        while looks.last.number == before and time.monotonic() < give_up:
            time.sleep(0.005)
        if wanted is not None and self.person._step >= STEPS:
            share = looks.last.points / len(self.target.object_points)
            asked = np.array(wanted["outline_px"]).tobytes()
            if asked not in self.shares:
                self.views.append(len(self.live.cameras["front"].views.kept))
            self.shares.setdefault(asked, []).append(share)
        return self.status()


def pupil_band(observations: Observations, theta: float) -> float:
    """σ of E(θ), metres."""
    result = calibrate(observations, model="ep_even")
    return float(entrance_pupil_band(result.camera, result.uncertainty.covariance, np.array([theta]))[1][0])


def of_random_views(camera: FisheyeCamera, target: Target, theta: float) -> float:
    """σ of E(θ) from 25 random views that show all of the target, as guided ones do, rendered and found likewise."""
    poses = random_poses(target, 120, 2, (0.1, 0.3), (0, np.degrees(camera.theta_max) - 15), (5, 50))
    detector, images, points, pixels = target.detector(), [], [], []
    for number, pose in enumerate(poses):
        found = detector.detect(render(camera, target, pose, imaging(1000 + number)))
        if len(images) == 25:
            break
        if len(found) == len(target.object_points):
            images.append(np.full(len(found), len(images)))
            points.append(found.point_index)
            pixels.append(found.pixels)
    assert len(images) == 25
    observed = Observations.create(
        target.object_points, np.concatenate(images), np.concatenate(points), np.concatenate(pixels), camera.image_size
    )
    return pupil_band(observed, theta)


def first_views(observations: Observations, count: int) -> Observations:
    return observations.select_images(np.arange(count))


# ChArUco before a narrow lens: 14 poses know E as well as 25 random views, and 90 views are not at the goal yet.
FALLS_SHORT = {"charuco, 120°": pytest.mark.xfail(reason="14 poses are needed, not 12", raises=AssertionError)}


@pytest.mark.parametrize("name", [pytest.param(name, marks=FALLS_SHORT.get(name, ())) for name in SCENES])
def test_a_person_is_led_to_the_goal(name: str, tmp_path: Path) -> None:
    camera, keys = SCENES[name]
    target = parse_target(keys)
    walk = Walk(camera, target, tmp_path, "auto")
    status = walk.status()
    try:
        while not status["goal_reached"] and status["views"] < MOST_VIEWS and walk.images < 4 * MOST_VIEWS:
            status = walk.step()
    finally:
        walk.live.stop()
    first = [shares[0] >= 0.8 for shares in walk.shares.values()]
    seen = [max(shares) >= 0.8 for shares in walk.shares.values()]
    theta = min(np.radians(60.0), 0.9 * camera.theta_max)
    random_band = of_random_views(camera, target, theta)
    observed = Observations.load(tmp_path / "front.npz")
    bands = {}  # by poses that were asked for and shown, each with what was kept on the way there
    for count, views in enumerate(walk.views, 1):
        if count % 2 == 0 and views >= 8:
            bands[count] = pupil_band(first_views(observed, views), theta)
    needed = next((count for count, band in bands.items() if band <= random_band), None)
    made = status["calibration"] or {}
    print(
        f"{name}: {status['views']} views of {walk.images} images, goal {status['goal_reached']}; asked for "
        f"{len(seen)} poses, found {sum(seen)}, at the first try {sum(first)}; E({np.degrees(theta):.0f}°) band of 25 "
        f"random views {1e6 * random_band:.1f} µm, with {needed} poses here "
        f"({', '.join(f'{count}: {1e6 * band:.1f}' for count, band in bands.items())}); "
        f"auto: {made.get('model')}, {made.get('entrance_pupil')}; open: {(status['guidance'] or {}).get('concerns')}; "
        f"{status['next']}"
    )
    assert status["goal_reached"] and status["guidance"]["concerns"] == []
    assert np.mean(seen) >= 0.95
    assert needed is not None and needed <= 12
