"""The live node among real processes: a camera driver, the calibrator, and someone who wants CameraInfo."""

from __future__ import annotations

import json
import os
import signal
import time
from pathlib import Path

import pytest
import yaml
from diagnostic_msgs.msg import DiagnosticArray
from known_scenes import half_size
from live_processes import LATCHED, at_this_load, wait_for
from rclpy.qos import QoSProfile, ReliabilityPolicy
from sensor_msgs.msg import CameraInfo, Image
from std_msgs.msg import String
from std_srvs.srv import Trigger

from fisheye_ep_calib.calibration import calibrate
from fisheye_ep_calib.simulation import observe, paper_camera, paper_poses
from fisheye_ep_calib.storage.camera_file import save_camera
from fisheye_ep_calib.target import load_target

pytestmark = pytest.mark.live

REPOSITORY = Path(__file__).resolve().parents[2]
TARGET = REPOSITORY / "config" / "targets" / "circle_grid_11x7.yaml"
RELIABLE = QoSProfile(depth=100, reliability=ReliabilityPolicy.RELIABLE)


def test_images_in_camera_info_and_files_out(start_calibrator, start_publisher, probe, rendered, tmp_path) -> None:
    calibrator = start_calibrator(
        cameras="[front]", target=TARGET, output_directory=tmp_path, auto_calibrate="false", model="ep_odd"
    )
    start_publisher(rendered, 10, "/front/image_raw")
    calibrator.wait_to_say("view 8 kept")
    images = probe.collect(Image, "/front/image_raw", RELIABLE, limit=100)
    infos = probe.collect(CameraInfo, "/front/camera_info", LATCHED)
    assert infos == []

    answer = probe.call(Trigger, "/calibrator/calibrate")
    assert answer.success, answer.message
    assert "front: ep_odd, RMS" in answer.message and "views" in answer.message

    def matched() -> list[CameraInfo]:
        stamps = {(image.header.stamp.sec, image.header.stamp.nanosec) for image in list(images)}
        found = [info for info in infos if (info.header.stamp.sec, info.header.stamp.nanosec) in stamps]
        return found if len(found) >= 5 else []

    info = wait_for(matched, "CameraInfo beside images")[-1]
    assert info.header.frame_id == "camera_0"
    assert (info.width, info.height, info.distortion_model, len(info.d)) == (1024, 1024, "equidistant", 4)
    assert 250 < info.k[0] < 350 and info.k[1] == 0

    latched = probe.collect(String, "/calibrator/front/calibration", LATCHED)
    wait_for(lambda: latched, "the latched YAML")
    written = (tmp_path / "front.yaml").read_text()
    assert latched[-1].data == written
    content = yaml.safe_load(written)
    assert content["camera_name"] == "front" and content["image_width"] == 1024

    assert "set aside" in probe.call(Trigger, "/calibrator/reset").message
    code, seconds = calibrator.interrupt()
    assert code == 0 and seconds < at_this_load(2.0)
    assert "Traceback" not in calibrator.output


def test_a_calibration_without_views_says_so(start_calibrator, probe, tmp_path) -> None:
    calibrator = start_calibrator(cameras="[front, rear]", target=TARGET, output_directory=tmp_path)
    answer = probe.call(Trigger, "/calibrator/calibrate")
    assert not answer.success
    assert "front: no view" in answer.message and "rear: no view" in answer.message
    code, seconds = calibrator.interrupt(signal.SIGTERM)
    assert code == 0 and seconds < at_this_load(2.0)
    assert "Traceback" not in calibrator.output


@pytest.mark.parametrize(
    ("parameters", "complaint"),
    [
        ({"cameras": "[front]"}, "front.target"),
        ({"cameras": "[front]", "target": "/nowhere.yaml"}, "/nowhere.yaml"),
        ({"cameras": "['../x']", "target": TARGET}, "'../x'"),
        ({"cameras": "[front]", "target": TARGET, "workers": "1000"}, "workers"),
        ({"cameras": "[front]", "target": TARGET, "model": "pinhole"}, "kannala"),
        ({"cameras": "[front]", "target": TARGET, "novelty__size": "-1.0"}, "Max: 10.0"),
        ({"cameras": "[front]", "target": TARGET, "front__transport": "theora"}, "raw, compressed"),
        ({"cameras": "[front]", "target": TARGET, "check": "true"}, "front.camera_file"),
    ],
    ids=lambda value: value if isinstance(value, str) else "",
)
def test_parameters_that_cannot_be_used_are_refused_in_one_line(start_calibrator, parameters, complaint) -> None:
    calibrator = start_calibrator(**parameters)
    assert calibrator.process.wait(60) == 2
    calibrator.end()
    (line,) = calibrator.lines
    assert line.startswith("calibrator: ") and complaint in line


def test_integers_are_accepted_for_doubles_and_misspelt_names_are_told(start_calibrator, tmp_path) -> None:
    calibrator = start_calibrator(
        cameras="[front]", target=TARGET, output_directory=tmp_path, novelty__size="1", front__topik="/x"
    )
    calibrator.wait_to_say("front.topik is not known")
    calibrator.wait_to_say("nobody publishes /front/image_raw")
    assert calibrator.interrupt()[0] == 0


@pytest.mark.parametrize("delay", [0.0, 0.4, 0.8, 1.5])
def test_ctrl_c_in_a_terminal_right_after_the_start(start_calibrator, tmp_path, delay) -> None:
    """It reaches the node's workers as well, while they are still starting."""
    calibrator = start_calibrator(cameras="[front, rear]", target=TARGET, output_directory=tmp_path)
    process = calibrator.process
    children = Path(f"/proc/{process.pid}/task")
    wait_for(lambda: any(path.read_text() for path in children.glob("*/children")), "the first child")
    time.sleep(delay)
    began = time.monotonic()
    os.killpg(process.pid, signal.SIGINT)
    assert process.wait(30) == 0
    assert time.monotonic() - began < at_this_load(2.0)
    calibrator.end()
    assert "Traceback" not in calibrator.output and "KeyboardInterrupt" not in calibrator.output


def test_a_calibration_is_checked_live(start_calibrator, start_publisher, probe, rendered, tmp_path) -> None:
    """The camera as it is holds; one whose centre is elsewhere does not, and is an error in diagnostics."""
    observed = observe(half_size(paper_camera()), load_target(TARGET), paper_poses(load_target(TARGET)), 0.03, 1)
    before = tmp_path / "before.yaml"
    save_camera(before, calibrate(observed, model="ep_odd"), "front", "simulated")
    wrong = tmp_path / "wrong.yaml"
    content = yaml.safe_load(before.read_text())
    content["entrance_pupil"]["intrinsics"]["cx"] += 6.0
    wrong.write_text(yaml.safe_dump(content))
    node = start_calibrator(
        cameras="[front, moved]", target=TARGET, output_directory=tmp_path / "results", check="true",
        front__camera_file=before, moved__camera_file=wrong, moved__topic="/front/image_raw",
    )  # fmt: skip
    statuses = probe.collect(String, "/calibrator/status", LATCHED, limit=5)
    diagnostics = probe.collect(DiagnosticArray, "/diagnostics", RELIABLE, limit=5)
    start_publisher(rendered, 3, "/front/image_raw")

    def checked() -> dict:
        cameras = json.loads(statuses[-1].data)["cameras"] if statuses else {}
        return cameras if all((camera["check"] or {}).get("views", 0) >= 5 for camera in cameras.values()) else {}

    cameras = wait_for(checked, "both cameras to be checked")
    assert cameras["front"]["level"] in ("OK", "WARN") and "the calibration holds" in cameras["front"]["message"]
    assert cameras["moved"]["level"] == "ERROR" and "no longer holds" in cameras["moved"]["message"]
    assert cameras["moved"]["next"] == "calibrate the camera anew"
    assert len(cameras["front"]["check"]["by_angle"]) >= 3 and cameras["front"]["views"] == 0
    wait_for(lambda: diagnostics and diagnostics[-1].status[1].level == b"\x02", "the error in diagnostics")
    node.wait_to_say("moved: the calibration no longer holds")
    assert "only checked" in probe.call(Trigger, "/calibrator/calibrate").message
    assert node.interrupt()[0] == 0 and not (tmp_path / "results").exists()
