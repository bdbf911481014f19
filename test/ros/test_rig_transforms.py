"""Transforms of a rig for /tf_static."""

from __future__ import annotations

import sys
from types import ModuleType, SimpleNamespace

import numpy as np
import pytest

pytest.importorskip("rclpy")
pytest.importorskip("geometry_msgs")

from builtin_interfaces.msg import Time  # noqa: E402

from fisheye_ep_calib.ros.rig_transforms import RigTransforms, rig_transforms  # noqa: E402

FIGURES = {
    "reference": "left",
    "cameras": {
        "left": {"position_m": [0.0, 0.0, 0.0], "quaternion_xyzw": [0.0, 0.0, 0.0, 1.0]},
        "right": {"position_m": [0.08, -0.01, 0.02], "quaternion_xyzw": [0.0, 0.6, 0.0, 0.8]},
    },
}


def test_the_reference_is_the_parent_and_the_frames_are_those_of_the_images() -> None:
    (transform,) = rig_transforms(FIGURES, {"left": "head_left", "right": "head_right"}, Time(sec=3))
    assert (transform.header.frame_id, transform.child_frame_id) == ("head_left", "head_right")
    assert transform.header.stamp.sec == 3
    place, turn = transform.transform.translation, transform.transform.rotation
    assert (place.x, place.y, place.z) == (0.08, -0.01, 0.02)
    assert np.allclose([turn.x, turn.y, turn.z, turn.w], [0, 0.6, 0, 0.8])


@pytest.mark.parametrize("frames", [{}, {"left": "", "right": ""}, {"left": "camera", "right": "camera"}])
def test_frames_that_are_missing_or_the_same_are_called_by_the_cameras(frames) -> None:
    (transform,) = rig_transforms(FIGURES, frames, Time())
    assert (transform.header.frame_id, transform.child_frame_id) == ("left_optical_frame", "right_optical_frame")


class Node:
    """What of a node is used."""

    def __init__(self) -> None:
        self.sent, self.warned, self.topics = [], [], []

    def create_publisher(self, kind, topic, quality):
        self.topics.append((topic, quality.durability.name, quality.depth))
        return SimpleNamespace(publish=self.sent.append)

    def get_logger(self):
        return SimpleNamespace(warning=self.warned.append)

    def get_clock(self):
        return SimpleNamespace(now=lambda: SimpleNamespace(to_msg=Time))


def test_they_are_latched_and_withdrawn(monkeypatch) -> None:
    messages = ModuleType("tf2_msgs.msg")
    messages.TFMessage = SimpleNamespace  # tf2_msgs is not on PyPI
    monkeypatch.setitem(sys.modules, "tf2_msgs", ModuleType("tf2_msgs"))
    monkeypatch.setitem(sys.modules, "tf2_msgs.msg", messages)
    node = Node()
    transforms = RigTransforms(node)
    transforms.publish(FIGURES, {})
    transforms.publish(None, {})
    assert node.topics == [("/tf_static", "TRANSIENT_LOCAL", 1)] and not node.warned
    assert [len(message.transforms) for message in node.sent] == [1, 0]


def test_without_tf2_msgs_it_is_said_once(monkeypatch) -> None:
    monkeypatch.setitem(sys.modules, "tf2_msgs", None)
    node = Node()
    transforms = RigTransforms(node)
    transforms.publish(FIGURES, {})
    assert not node.sent and len(node.warned) == 1 and "tf2_msgs" in node.warned[0]
