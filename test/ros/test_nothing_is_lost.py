"""A node that is killed at any moment has lost no view that it reported, and goes on where it was."""

from __future__ import annotations

import contextlib
import json
import random
import shutil
import signal
import time
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest
from live_processes import LATCHED, Program, kept, wait_for
from std_msgs.msg import String
from std_srvs.srv import Trigger

from fisheye_ep_calib.calibration import Observations, calibrate
from fisheye_ep_calib.storage.camera_file import load_camera
from fisheye_ep_calib.target import load_target

pytestmark = pytest.mark.live

REPOSITORY = Path(__file__).resolve().parents[2]
TARGET = REPOSITORY / "config" / "targets" / "circle_grid_11x7.yaml"
EVERY_VIEW = {"novelty__position": 0.0, "novelty__size": 0.0, "novelty__tilt": 0.0}


def views_when_idle(statuses: list[String]) -> dict[str, int]:
    """Each camera's views once nothing comes any more and all that came has been looked at.

    statuses: that the node publishes; two that are made from now on have to say so.
    """
    seen = len(statuses)

    def idle() -> dict[str, dict[str, Any]]:
        if len(statuses) < seen + 2:
            return {}
        before, now = (json.loads(status.data)["cameras"] for status in statuses[-2:])
        looked_at = ("searched", "dropped", "unreadable")
        ended = all(
            camera["received"] == before[name]["received"] == sum(camera[key] for key in looked_at)
            for name, camera in now.items()
        )
        return now if ended else {}

    return {name: camera["views"] for name, camera in wait_for(idle, "an idle node").items()}


@pytest.fixture
def network_only(domain: int, monkeypatch: pytest.MonkeyPatch) -> None:
    """A process killed within Fast DDS's shared memory may leave a port that its peers go on writing to unheard."""
    monkeypatch.delenv("FASTRTPS_DEFAULT_PROFILES_FILE")
    monkeypatch.setenv("FASTDDS_BUILTIN_TRANSPORTS", "UDPv4")


def start_that_hears(start_calibrator, parameters: dict) -> Program:
    """A calibrator that has kept a view. Where its peers died so often, Fast DDS leaves one start in fifty unheard."""
    for _ in range(3):
        calibrator = start_calibrator(**parameters)
        calibrator.wait_to_say("receiving")
        with contextlib.suppress(AssertionError):
            wait_for(lambda: " kept" in calibrator.output, "a view", patience=40.0)  # noqa: B023
            return calibrator
        calibrator.interrupt(signal.SIGKILL)
    raise AssertionError(f"three starts heard nothing, the last one said:\n{calibrator.output}")


def kill_and_resume(times: int, start_calibrator, start_publisher, probe, rendered, folder: Path) -> None:
    rng = random.Random(times)
    parameters = {
        "cameras": "[front]",
        "target": TARGET,
        "output_directory": folder,
        "model": "ep_odd",
        "minimum_views": 5,
        "maximum_views": 1000,
        "front__transport": "compressed",
        **EVERY_VIEW,
    }
    statuses = probe.collect(String, "/calibrator/status", LATCHED)
    publisher = start_publisher(rendered, 10, "--compressed", "/front/image_raw/compressed")
    reported = 0
    for turn in range(times):
        # Every other one ends after it has reported something; some only after they have started.
        calibrator = start_that_hears(start_calibrator, parameters) if turn % 2 == 0 else start_calibrator(**parameters)
        calibrator.wait_to_say("receiving")
        time.sleep(rng.uniform(0.0, 1.0))
        calibrator.interrupt(signal.SIGKILL)
        assert kept(calibrator.output) >= reported, calibrator.output
        reported = kept(calibrator.output)
        if reported:
            observations = Observations.load(folder / "front.npz")
            assert reported <= observations.view_count <= reported + 2  # two workers may be about to report
        if (folder / "front.yaml").exists():
            load_camera(folder / "front.yaml")
    calibrator = start_that_hears(start_calibrator, parameters)
    assert reported >= times / 2
    wait_for(lambda: kept(calibrator.output) >= reported + 3, "three views more")
    publisher.end()
    views_when_idle(statuses)
    answer = probe.call(Trigger, "/calibrator/calibrate")
    assert answer.success, answer.message
    assert calibrator.interrupt()[0] == 0
    undisturbed = calibrate(Observations.load(folder / "front.npz"), model="ep_odd")
    assert f"{undisturbed.views} views" in answer.message
    camera = load_camera(folder / "front.yaml")
    print(f"killed {times} times: {reported} views reported till then, all there; {answer.message}")
    np.testing.assert_allclose(camera.parameters, undisturbed.camera.parameters, rtol=1e-9)


def test_a_second_node_says_who_has_the_folder_and_ends(start_calibrator, start_publisher, rendered, tmp_path) -> None:
    parameters = {"cameras": "[front]", "target": TARGET, "output_directory": tmp_path / "results", **EVERY_VIEW}
    first = start_calibrator(**parameters)
    start_publisher(rendered, 5, "/front/image_raw")
    first.wait_to_say("view 1 kept")
    second = start_calibrator("-r", "__node:=second", **parameters)
    assert second.process.wait(60) == 1
    second.end()
    (line,) = second.lines
    assert line.startswith("calibrator: ") and f"process {first.process.pid} on" in line and "is in use by" in line
    first.interrupt(signal.SIGKILL)
    third = start_calibrator(**parameters)
    third.wait_to_say("going on with")
    assert third.interrupt()[0] == 0


def test_a_folder_that_is_removed_and_a_save_that_is_refused(
    start_calibrator, start_publisher, probe, rendered, tmp_path
) -> None:
    folder = tmp_path / "results"
    calibrator = start_calibrator(
        cameras="[front]", target=TARGET, output_directory=folder, auto_calibrate="false", **EVERY_VIEW
    )
    statuses = probe.collect(String, "/calibrator/status", LATCHED)
    publisher = start_publisher(rendered, 5, "/front/image_raw")
    calibrator.wait_to_say("view 3 kept")
    publisher.end()
    views = views_when_idle(statuses)["front"]
    shutil.rmtree(folder)
    folder.write_text("in the way")
    assert "not written" in probe.call(Trigger, "/calibrator/save").message
    assert not calibrator.said("everything is written now")
    folder.unlink()
    calibrator.wait_to_say("front: everything is written now")
    assert Observations.load(folder / "front.npz").view_count == views
    shutil.rmtree(folder)
    assert calibrator.interrupt()[0] == 0
    assert Observations.load(folder / "front.npz").view_count == views


def test_what_the_disk_refuses_to_the_end_is_said_to_be_lost(
    start_calibrator, start_publisher, rendered, tmp_path
) -> None:
    folder = tmp_path / "results"
    folder.write_text("in the way")
    calibrator = start_calibrator(cameras="[front]", target=TARGET, output_directory=folder, **EVERY_VIEW)
    start_publisher(rendered, 5, "/front/image_raw")
    calibrator.wait_to_say("view 1 kept, 77 points, in memory only")
    assert calibrator.interrupt()[0] == 0
    assert "front: ended with what the disk has not taken; that is lost" in calibrator.output


def test_ten_calls_at_once_are_one_calibration_and_one_camera_is_reset(
    start_calibrator, start_publisher, probe, rendered, tmp_path
) -> None:
    calibrator = start_calibrator(
        cameras="[front, rear]",
        target=TARGET,
        output_directory=tmp_path,
        auto_calibrate="false",
        keep_images="true",
        model="ep_odd",
        **EVERY_VIEW,
    )
    statuses = probe.collect(String, "/calibrator/status", LATCHED)
    publisher = start_publisher(rendered, 5, "/front/image_raw", "/rear/image_raw")
    wait_for(lambda: all(calibrator.said(f"{name}: view 6 kept") for name in ("front", "rear")), "six views each")
    publisher.end()
    views = views_when_idle(statuses)["front"]
    client = probe.node.create_client(Trigger, "/calibrator/calibrate")
    wait_for(client.service_is_ready, "the service")
    calls = [client.call_async(Trigger.Request()) for _ in range(10)]
    wait_for(lambda: all(call.done() for call in calls), "ten answers")
    assert len({call.result().message for call in calls}) == 1 and calls[0].result().success
    for name in ("front", "rear"):
        calibrator.wait_to_say(f"{name}: ep_odd, RMS")
        assert calibrator.output.count(f"{name}: ep_odd, RMS") == 1

    assert Observations.load(tmp_path / "front.npz").view_count == views
    images = sorted((tmp_path / "images" / "front").glob("*.png"))
    assert len(images) == views and calibrator.output.count("front: view") == views
    found = load_target(TARGET).detector().detect(cv2.imread(str(images[0]), cv2.IMREAD_UNCHANGED))
    assert len(found) > 60

    assert "front: " in probe.call(Trigger, "/calibrator/front/reset").message
    assert not (tmp_path / "front.npz").exists() and (tmp_path / "rear.npz").exists()
    assert not (tmp_path / "images" / "front").exists() and (tmp_path / "images" / "rear").exists()
    assert len(list(tmp_path.glob("images.*/front/*.png"))) == views
    answer = probe.call(Trigger, "/calibrator/rear/commit")
    assert "nobody serves /rear/set_camera_info" in answer.message and "front" not in answer.message


@pytest.mark.slow
def test_killed_twenty_times(network_only, start_calibrator, start_publisher, probe, rendered, tmp_path) -> None:
    kill_and_resume(20, start_calibrator, start_publisher, probe, rendered, tmp_path)
