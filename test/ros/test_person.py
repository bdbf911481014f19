"""Someone who sees only the page brings a camera that nobody knows to the goal, with nothing left open."""

from __future__ import annotations

import array
import json
import re
import time
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from headless_browser import HeadlessBrowser, chromium
from live_processes import wait_for
from rclpy.qos import QoSProfile, ReliabilityPolicy
from sensor_msgs.msg import Image
from simulated_person import SimulatedPerson

from fisheye_ep_calib.camera import FisheyeCamera
from fisheye_ep_calib.simulation.rendering import Imaging, render
from fisheye_ep_calib.storage.camera_file import load_camera
from fisheye_ep_calib.target import load_target

pytest.importorskip("aiohttp", reason="aiohttp is not installed: pip install '.[web]'")
pytestmark = [pytest.mark.live, pytest.mark.slow, pytest.mark.timeout(1500)]

LENS = FisheyeCamera(
    image_size=(640, 640),
    fx=196.8,
    fy=197.2,
    skew=0.0,
    cx=321.5,
    cy=317.5,
    radial=(0.02, -0.004, 0.0006, 0.0),
    model="ep_even",
    coefficients=(-0.7e-3, -0.15e-3),
    theta_max=np.radians(93),
)
PATIENCE = 1200.0  # seconds
MOST_VIEWS = 90


def message(image: np.ndarray, number: int) -> Image:
    height, width = image.shape
    made = Image(height=height, width=width, encoding="mono8", step=width, data=array.array("B", image.tobytes()))
    made.header.stamp.sec, made.header.frame_id = 1000 + number, "front"
    return made


def told(browser: HeadlessBrowser) -> dict[str, Any]:
    """What the page knows."""
    known = browser.evaluate("latest === null ? null : JSON.stringify(latest.cameras.front)")
    return {} if known is None else dict(json.loads(known))


def look_at(browser: HeadlessBrowser, images: Any, image: np.ndarray, number: int, path: Path) -> None:
    """A picture of the page, opened anew, while the board is held still."""
    browser.visit(browser.evaluate("location.href"), width=1366, height=768)
    for step in range(20):
        images.publish(message(image, number + step))
        time.sleep(0.3)
    browser.screenshot(path, whole=False)


@pytest.fixture
def browser():
    executable = chromium()
    if executable is None:
        pytest.skip("no Chromium here: apt-get install chromium")
    with HeadlessBrowser(executable) as browser:
        yield browser


def test_a_person_who_does_what_the_page_says_reaches_the_goal(start_calibrator, probe, browser, tmp_path) -> None:
    node = start_calibrator(
        cameras="[front]", target="circle_grid_11x7", output_directory=tmp_path / "results", web_port=0, model="ep_even"
    )
    node.wait_to_say("the page to look at: ")
    browser.visit(re.findall(r"the page to look at: (\S+)", node.output)[0], width=1366, height=768)
    quality = QoSProfile(depth=10, reliability=ReliabilityPolicy.RELIABLE)
    images = probe.node.create_publisher(Image, "/front/image_raw", quality)
    wait_for(images.get_subscription_count, "the node's subscription")
    target = load_target("circle_grid_11x7")
    person = SimulatedPerson(LENS, target, seed=3)
    began, number, first, status = time.monotonic(), 0, False, told(browser)
    while time.monotonic() - began < PATIENCE and not status.get("goal_reached"):
        person.look((status.get("wanted") or {}).get("outline_px"))
        looks = status.get("look", {}).get("number", 0)
        imaging = Imaging(blur=0.7, noise=2.0, texture=40.0, vignetting=0.3, seed=number)
        images.publish(message(render(LENS, target, person.move(), imaging), number))
        number += 1
        give_up = time.monotonic() + 10
        while (status := told(browser)).get("look", {}).get("number", 0) == looks and time.monotonic() < give_up:
            time.sleep(0.02)
        if not first and status.get("views", 0) >= 3:
            first = True
            look_at(browser, images, render(LENS, target, person.pose, imaging), number, tmp_path / "first.png")
            number += 25
        assert status.get("views", 0) <= MOST_VIEWS, "many more views than forty guided ones should take"
    seconds = time.monotonic() - began
    look_at(browser, images, render(LENS, target, person.pose, imaging), number, tmp_path / "last.png")
    status = told(browser)
    print(f"{status['views']} views kept of {number} images in {seconds:.0f} s: {status['next']}")
    assert status["goal_reached"] and status["guidance"]["concerns"] == [] and status["level"] == "OK"
    assert browser.evaluate("document.getElementById('say').textContent") == "Done: save, or go on"
    assert browser.evaluate("document.getElementById('concerns-box').hidden")
    assert status["guidance"]["coverage"] >= 0.9 and browser.complaints() == []
    camera = load_camera(tmp_path / "results" / "front.yaml")
    for degrees in (30, 60, 80):
        theta = np.radians(degrees)
        assert abs(float(camera.entrance_pupil(theta) - LENS.entrance_pupil(theta))) < 1e-4
    assert camera.theta_max > np.radians(80)
