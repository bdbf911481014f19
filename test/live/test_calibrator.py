"""The live calibrator without ROS: messages in, calibrations out."""

from __future__ import annotations

import threading
import time
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest

from fisheye_ep_calib.live.announcer import Announcer
from fisheye_ep_calib.live.calibrator import LiveCalibrator
from fisheye_ep_calib.live.settings import CameraSettings, Settings, Tuning
from fisheye_ep_calib.live.status import Level, Reception
from fisheye_ep_calib.live.work_pool import Task
from fisheye_ep_calib.simulation import paper_camera, paper_poses, paper_target
from fisheye_ep_calib.simulation.rendering import render
from fisheye_ep_calib.storage.camera_file import load_camera

PATIENCE = 120.0


class Listener:
    """Remembers what it is told."""

    def __init__(self) -> None:
        self.outcomes: list = []
        self.seen: list = []
        self.ready = threading.Event()

    def calibrated(self, camera, outcome) -> None:
        self.outcomes.append((camera, outcome))
        self.ready.set()

    def wanted_pictures(self, camera) -> frozenset[str]:
        return frozenset({"raw", "page"})

    def pictures(self, camera, header, pictures) -> None:
        self.seen.append((camera, header, pictures))


def settings(folder: Path, *names: str) -> Settings:
    cameras = [
        CameraSettings(name, f"/{name}/image_raw", False, paper_target(), "ep_odd", None, "", "") for name in names
    ]
    return Settings(tuple(cameras), folder, resume=True, workers=2)


@pytest.fixture(scope="module")
def images() -> list[np.ndarray]:
    camera, target = paper_camera(), paper_target()
    return [render(camera, target, pose) for pose in paper_poses(target)[[0, 2, 4, 6, 8, 10, 13, 16, 19, 22]]]


def message(image: np.ndarray) -> SimpleNamespace:
    height, width = image.shape
    return SimpleNamespace(
        header=SimpleNamespace(frame_id="optical"),
        height=height,
        width=width,
        encoding="mono8",
        is_bigendian=0,
        step=width,
        data=image.tobytes(),
    )


def wait_for(condition) -> None:
    give_up = time.monotonic() + PATIENCE
    while not condition() and time.monotonic() < give_up:
        time.sleep(0.02)
    assert condition()


def test_from_images_to_a_calibration_and_on_after_a_restart(tmp_path: Path, images) -> None:
    listener, said = Listener(), []
    live = LiveCalibrator(
        settings(tmp_path, "front", "rear"),
        Tuning(minimum_views=len(images)),
        Announcer(said.append, said.append),
        listener,
    )
    camera = live.cameras["front"]
    try:
        assert not live.calibrate().success
        live.offer("rear", message(np.zeros((0, 5), np.uint8)), "bad")
        for number, image in enumerate(images):
            live.offer("front", message(image), str(number))
            wait_for(lambda number=number: len(camera.views.kept) == number + 1)
        assert [view.name for view in camera.views.kept] == [str(number) for number in range(len(images))]
        assert len(listener.seen) >= len(images) - 1
        assert listener.ready.wait(PATIENCE), "calibrates by itself"
        name, outcome = listener.outcomes[0]
        assert name == "front" and outcome.camera.model == "ep_odd"
        assert outcome.advice is not None and outcome.advice.plan[0].sentence.startswith("hold the target")

        arrival = {name: Reception(f"/{name}/image_raw", False, 0.01, 0.02) for name in ("front", "rear")}
        front, rear = live.status(arrival)
        assert front.level is Level.WARN and front.values["views"] == len(images)
        assert rear.level is Level.OK and rear.values["unreadable"] == 1
        assert len([text for text in said if text.startswith("rear: a frame is skipped")]) == 1
        assert front.values["guidance"]["coverage"] > 0.5
        told = front.values["calibration"]
        assert told["views"] == len(images) and told["entrance_pupil"] in ("supported", "not distinguishable")
        assert {finding["name"] for finding in told["findings"]} >= {"coverage", "depth", "few_views"}
        raised = {
            finding["text"] for finding in told["findings"] if finding["raised"] and finding["name"] != "coverage"
        }
        concerns = front.values["guidance"]["concerns"]
        # Coverage counts against the image circle here.
        assert raised == {text for text in concerns if "% of the field that the image shows" not in text}
        assert front.message == concerns[0] and concerns[0] in front.next and not front.values["goal_reached"]
        assert front.values["wanted"]["sentence"] in front.next and len(front.values["wanted"]["outline_px"]) > 10
        assert front.values["event"] == "kept"
        wait_for(lambda: camera.camera_file.exists())
        np.testing.assert_allclose(load_camera(camera.camera_file).parameters, outcome.camera.parameters)
    finally:
        live.stop()

    again = Listener()
    live = LiveCalibrator(
        settings(tmp_path, "front"), Tuning(minimum_views=len(images)), Announcer(said.append, said.append), again
    )
    try:
        assert any(f"going on with {len(images)} views" in text for text in said)
        assert again.ready.wait(PATIENCE)
        np.testing.assert_allclose(again.outcomes[0][1].camera.parameters, outcome.camera.parameters, rtol=1e-9)
        answer = live.reset()
        assert answer.success and f"{len(images)} views set aside" in answer.text
        assert again.outcomes[-1] == ("front", None)
    finally:
        live.stop()


def test_a_full_disk_is_told_once_and_retried(tmp_path: Path, images) -> None:
    blocked = tmp_path / "results"
    blocked.write_text("a file where the folder should be")
    said: list[str] = []
    live = LiveCalibrator(
        settings(blocked, "front"), Tuning(auto_calibrate=False), Announcer(said.append, said.append), Listener()
    )
    camera = live.cameras["front"]
    try:
        for number, image in enumerate(images[:3]):
            live.offer("front", message(image), str(number))
            wait_for(lambda number=number: len(camera.views.kept) == number + 1)
        assert not live.save().success
        assert len([text for text in said if "cannot write" in text]) == 1
        blocked.unlink()
        live.retry_writing()
        assert camera.views.file.exists() and not camera.unwritten
        assert said[-1] == "front: everything is written now"
    finally:
        live.stop()


def test_a_reset_leaves_no_calibration_and_no_frame_behind(tmp_path: Path, images) -> None:
    listener, said = Listener(), []
    live = LiveCalibrator(
        settings(tmp_path, "front"), Tuning(auto_calibrate=False), Announcer(said.append, said.append), listener
    )
    camera = live.cameras["front"]
    try:
        for number, image in enumerate(images[:5]):
            live.offer("front", message(image), str(number))
            wait_for(lambda number=number: len(camera.views.kept) == number + 1)
        answers: list = []
        asked = threading.Thread(target=lambda: answers.append(live.calibrate()))
        live.pool.queue_job(Task(time.sleep, lambda: (1.0,), lambda result, error: None))
        asked.start()
        live.offer("front", message(images[5]), "5")
        answer = live.reset()
        assert answer.success and "5 views set aside" in answer.text
        asked.join(PATIENCE)
        assert not answers[0].success and "reset meanwhile" in answers[0].text
        wait_for(lambda: len(listener.seen) >= 6)
        assert camera.views.kept == () and camera.outcome is None
        assert listener.outcomes == [("front", None)] and not camera.camera_file.exists()
        assert not any("not calibrated" in text for text in said)
        live.offer("front", message(images[6]), "6")
        wait_for(lambda: [view.name for view in camera.views.kept] == ["6"])
    finally:
        live.stop()
