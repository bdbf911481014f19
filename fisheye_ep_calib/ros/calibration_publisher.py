"""Publishes one camera's calibration: CameraInfo with each image, and the whole YAML for whoever comes late."""

from __future__ import annotations

import threading
from typing import Any

from rclpy.node import Node
from rclpy.publisher import Publisher
from rclpy.qos import DurabilityPolicy, QoSProfile, ReliabilityPolicy
from sensor_msgs.msg import CameraInfo
from std_msgs.msg import Header, String

from fisheye_ep_calib.live.outcome import Outcome
from fisheye_ep_calib.live.settings import CameraSettings
from fisheye_ep_calib.ros.camera_info_message import camera_info_message

LATCHED = QoSProfile(
    depth=1, durability=DurabilityPolicy.TRANSIENT_LOCAL, reliability=ReliabilityPolicy.RELIABLE
)


class CalibrationPublisher:
    """Silent until the camera is calibrated."""

    def __init__(self, node: Node, camera: CameraSettings) -> None:
        self._node = node
        self._camera = camera
        self._yaml = node.create_publisher(String, f"~/{camera.name}/calibration", LATCHED)
        self._info_publisher: Publisher | None = None
        self._info: CameraInfo | None = None
        self._header: Header | None = None
        self._lock = threading.Lock()

    def update(self, outcome: Outcome | None) -> None:
        """A new calibration is in force; None: there is none any more."""
        with self._lock:
            self._info = None if outcome is None else camera_info_message(outcome.info)
            if outcome is None:
                return
            if self._info_publisher is None:
                self._info_publisher = self._node.create_publisher(CameraInfo, self._info_topic(), LATCHED)
        self._yaml.publish(String(data=outcome.yaml))
        if self._header is not None:
            self._send(self._header)

    def publish_info(self, image: Any) -> None:
        """CameraInfo with the header of an image message, if the camera is calibrated for images of its size."""
        self._header = image.header
        info = self._info
        if info is None:
            return
        size = getattr(image, "width", info.width), getattr(image, "height", info.height)
        if size == (info.width, info.height):  # a compressed image does not tell; it is taken on trust
            self._send(image.header)

    def _send(self, header: Header) -> None:
        with self._lock:
            if self._info is not None and self._info_publisher is not None:
                self._info.header = header
                self._info_publisher.publish(self._info)

    def _info_topic(self) -> str:
        """The configured topic, unless a driver publishes there: two would contradict each other."""
        wanted = self._camera.camera_info_topic
        if self._node.count_publishers(self._node.resolve_topic_name(wanted)) == 0:
            return wanted
        own = f"~/{self._camera.name}/camera_info"
        self._node.get_logger().warning(
            f"{self._node.resolve_topic_name(wanted)} has a publisher already, so CameraInfo goes to "
            f"{self._node.resolve_topic_name(own)}; ~/commit hands the calibration to the driver"
        )
        return own
