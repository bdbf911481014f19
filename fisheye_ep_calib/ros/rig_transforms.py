"""Where a rig's cameras are, on /tf_static: the reference camera's optical frame is the parent of the others'.

tf2_msgs is ROS's, and part of every installation of it; without it there is no tf to publish to.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from geometry_msgs.msg import TransformStamped
from rclpy.node import Node

from fisheye_ep_calib.formats.static_transform import frame_of
from fisheye_ep_calib.ros.quality import LATCHED

TOPIC = "/tf_static"


class RigTransforms:
    """Latched: whoever comes later gets them too; each message replaces the one before."""

    def __init__(self, node: Node) -> None:
        self._node = node
        try:
            from tf2_msgs.msg import TFMessage
        except ImportError:
            node.get_logger().warning("rig_tf: tf2_msgs is not installed (ros-jazzy-tf2-msgs): nothing on /tf_static")
            self._message, self._publisher = None, None
            return
        self._message = TFMessage
        self._publisher = node.create_publisher(TFMessage, TOPIC, LATCHED)

    def publish(self, figures: Mapping[str, Any] | None, frames: Mapping[str, str]) -> None:
        """figures: of the rig, as ``RigCalibration.to_dict`` gives them; None: it is in force no more.

        frames: by camera name, the frame_id of its images, where they have one.
        """
        if self._publisher is None or self._message is None:
            return
        transforms = [] if figures is None else rig_transforms(figures, frames, self._node.get_clock().now().to_msg())
        self._publisher.publish(self._message(transforms=transforms))


def rig_transforms(figures: Mapping[str, Any], frames: Mapping[str, str], stamp: Any) -> list[TransformStamped]:
    """The reference from each other camera. Frames are those of the images where they are there and differ."""
    named = {name: frames.get(name) or frame_of(name) for name in figures["cameras"]}
    if len(set(named.values())) < len(named):
        named = {name: frame_of(name) for name in named}
    transforms = []
    for name, camera in figures["cameras"].items():
        if name == figures["reference"]:
            continue
        transform = TransformStamped()
        transform.header.stamp, transform.header.frame_id = stamp, named[figures["reference"]]
        transform.child_frame_id = named[name]
        translation, rotation = transform.transform.translation, transform.transform.rotation
        translation.x, translation.y, translation.z = camera["position_m"]
        rotation.x, rotation.y, rotation.z, rotation.w = camera["quaternion_xyzw"]
        transforms.append(transform)
    return transforms
