"""Two cameras that are fixed to each other, over real DDS: from images to where one is in the other's frame."""

from __future__ import annotations

import array
import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import yaml
from diagnostic_msgs.msg import DiagnosticArray
from live_processes import LATCHED, wait_for
from rclpy.qos import QoSProfile, ReliabilityPolicy
from scipy.spatial.transform import Rotation
from sensor_msgs.msg import Image
from simulated_rig import cameras, errors, place, targets_between
from std_msgs.msg import String
from std_srvs.srv import Trigger

from fisheye_ep_calib.simulation import Imaging, paper_target, render

pytestmark = pytest.mark.live

REPOSITORY = Path(__file__).resolve().parents[2]
TARGET = REPOSITORY / "config" / "targets" / "circle_grid_11x7.yaml"
RELIABLE = QoSProfile(depth=10, reliability=ReliabilityPolicy.RELIABLE)
NAMES = ("left", "right")
LEFT_FROM_RIGHT = place(25, (0.08, 0.002, 0.01), (0.05, 0.0, 0.02))
SIDE = 1024  # pixels
MOMENTS = 16
CHI_SQUARE = 22.5  # 99.9 % of six degrees of freedom


@pytest.fixture(scope="module")
def images() -> list[tuple[np.ndarray, ...]]:
    """What both cameras see at each moment; the target moves all over what they have in common."""
    halved = ("fx", "fy", "skew", "cx", "cy")
    models = [
        replace(model, image_size=(SIDE, SIDE), **{name: getattr(model, name) / 2 for name in halved})
        for model in cameras(2, theta_max_deg=75)
    ]
    places, target, imaging = (np.eye(4), LEFT_FROM_RIGHT), paper_target(), Imaging(blur=0.6, noise=1.0)
    targets = targets_between(*places, target, MOMENTS, seed=4, distance=(0.1, 0.2), theta_deg=45)
    return [
        tuple(
            render(model, target, np.linalg.inv(camera) @ pose, imaging)
            for model, camera in zip(models, places, strict=True)
        )
        for pose in targets
    ]


def message(image: np.ndarray, moment: int) -> Image:
    data = array.array("B", image.tobytes())
    made = Image(height=SIDE, width=SIDE, encoding="mono8", step=SIDE, data=data)
    made.header.stamp.sec, made.header.stamp.nanosec = 1000 + moment, 1_000_000
    return made


def test_two_cameras_become_a_rig(start_calibrator, probe, images, tmp_path) -> None:
    calibrator = start_calibrator(
        cameras="[left, right]", target=TARGET, output_directory=tmp_path, model="ep_even", rig="true"
    )
    statuses = probe.collect(String, "/calibrator/status", LATCHED, limit=5)
    rigs = probe.collect(String, "/calibrator/rig", LATCHED)
    diagnostics = probe.collect(DiagnosticArray, "/diagnostics", RELIABLE, limit=5)
    publishers = [probe.node.create_publisher(Image, f"/{name}/image_raw", RELIABLE) for name in NAMES]
    wait_for(lambda: all(publisher.get_subscription_count() for publisher in publishers), "the subscriptions")
    wait_for(lambda: statuses, "a status")
    rig = json.loads(statuses[-1].data)["rig"]
    assert rig["apart"] == ["right"] and rig["next"].startswith("hold the target where left and right both see it")

    def searched() -> list[int]:
        status = json.loads(statuses[-1].data)["cameras"]
        return [status[name]["searched"] for name in NAMES]

    for moment, seen in enumerate(images):
        for publisher, image in zip(publishers, seen, strict=True):
            publisher.publish(message(image, moment))
        wait_for(lambda moment=moment: min(searched()) > moment, f"moment {moment}")

    def placed() -> dict:
        rig = json.loads(statuses[-1].data)["rig"]
        return rig if rig["calibrated"] and rig["level"] == "OK" else {}

    rig = wait_for(placed, "the rig")
    assert rig["joined"] == ["left", "right"] and rig["message"] == "2 of 2 cameras placed"
    assert rig["common_views"][0]["views"] >= 10
    answer = probe.call(Trigger, "/calibrator/calibrate")
    assert answer.success and "rig: " in answer.message and "right at (" in answer.message, answer.message
    answer = probe.call(Trigger, "/calibrator/save")
    assert answer.success and "rig.yaml" in answer.message
    written = (tmp_path / "rig.yaml").read_text()
    wait_for(lambda: rigs and rigs[-1].data == written, "the latched rig")
    block = yaml.safe_load(written)["cameras"]["right"]
    found = np.array(block["reference_from_camera"])
    angle, distance = errors(found, LEFT_FROM_RIGHT)
    turn = Rotation.from_matrix(LEFT_FROM_RIGHT[:3, :3] @ found[:3, :3].T).as_rotvec()
    step = np.concatenate([turn, LEFT_FROM_RIGHT[:3, 3] - found[:3, 3]])
    distance_sigma = np.linalg.norm(block["position_sigma"])
    print(
        f"{answer.message}\noff by {1e3 * distance:.3f} mm (stated {1e3 * distance_sigma:.3f}) and {1e3 * angle:.3f} "
        f"mrad (stated {1e3 * np.linalg.norm(block['rotation_sigma']):.3f})"
    )
    assert step @ np.linalg.solve(np.array(block["covariance"]), step) < CHI_SQUARE
    assert distance_sigma < 1e-3 and block["camera_file"] == "right.yaml"
    chain = yaml.safe_load((tmp_path / "camchain.yaml").read_text())
    np.testing.assert_allclose(np.linalg.inv(chain["cam1"]["T_cn_cnm1"]), found, atol=1e-9)

    def told() -> list:
        return [one for last in diagnostics[-1:] for one in last.status if one.message == "2 of 2 cameras placed"]

    (diagnostic,) = wait_for(told, "the rig's diagnostics")
    assert diagnostic.name == "calibrator: rig" and diagnostic.hardware_id == "rig"

    assert probe.call(Trigger, "/calibrator/reset").success
    wait_for(lambda: rigs[-1].data == "", "the end of the rig")
    assert calibrator.interrupt()[0] == 0
    assert "Traceback" not in calibrator.output


def test_a_rig_of_one_camera_is_refused(start_calibrator) -> None:
    calibrator = start_calibrator(cameras="[left]", target=TARGET, rig="true")
    assert calibrator.process.wait(60) == 2
    calibrator.end()
    (line,) = calibrator.lines
    assert line.startswith("calibrator: parameter rig: ")
