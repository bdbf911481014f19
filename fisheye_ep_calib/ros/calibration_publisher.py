"""Publishes what one camera's calibration gives: CameraInfo with each image, the YAML, and the overlay."""

from __future__ import annotations

import threading
from typing import Any

from rclpy.node import Node
from rclpy.publisher import Publisher
from sensor_msgs.msg import CameraInfo, CompressedImage, Image
from std_msgs.msg import Header, String

from fisheye_ep_calib.camera.camera_info import PlainCameraInfo, reduced
from fisheye_ep_calib.errors import InputError
from fisheye_ep_calib.live.outcome import Outcome
from fisheye_ep_calib.live.overlay import Pictures
from fisheye_ep_calib.live.settings import CameraSettings
from fisheye_ep_calib.ros.messages import camera_info_message, compressed_message, picture_message
from fisheye_ep_calib.ros.quality import LATCHED, LATCHED_STREAM, overridden
from fisheye_ep_calib.storage.image_header import declared_size
from fisheye_ep_calib.storage.pictures import Picture

_MOST_SIZES_TOLD = 8  # of images that are not the camera's; images may come in ever other sizes


class CalibrationPublisher:
    """CameraInfo and YAML are silent until the camera is calibrated, the overlay until somebody looks."""

    def __init__(self, node: Node, camera: CameraSettings) -> None:
        self._node = node
        self._camera = camera
        self._yaml = node.create_publisher(String, f"~/{camera.name}/calibration", LATCHED)
        self._annotated = node.create_publisher(Image, f"~/{camera.name}/annotated", 2)
        self._compressed = node.create_publisher(CompressedImage, f"~/{camera.name}/annotated/compressed", 2)
        self._info_publisher: Publisher | None = None
        self._told = False
        self._plain: PlainCameraInfo | None = None
        self._info: CameraInfo | None = None
        self._size = (0, 0)  # of the latest image
        self._sizes_told: set[str] = set()
        self._header: Header | None = None
        self._lock = threading.Lock()

    @property
    def watched(self) -> frozenset[str]:
        """Which of the pictures anybody subscribes to."""
        publishers = {"raw": self._annotated, "compressed": self._compressed}
        return frozenset(name for name, publisher in publishers.items() if publisher.get_subscription_count() > 0)

    @property
    def frame(self) -> str:
        """The frame_id of the camera's images; "" where none came yet, or they have none."""
        return "" if self._header is None else str(self._header.frame_id)

    def update(self, outcome: Outcome | None) -> None:
        """A new calibration is in force; None: there is none any more."""
        with self._lock:
            self._plain = None if outcome is None else outcome.info
            self._fit_info()
        if outcome is None:
            if self._told:  # latched: whoever comes later must not take the old one for valid
                self._yaml.publish(String())
            return
        self._told = True
        self._yaml.publish(String(data=outcome.yaml))
        if self._header is not None:
            for _ in range(LATCHED_STREAM.depth):  # whoever comes later must not be given an older one first
                self._send(self._header)

    def publish_info(self, image: Any) -> None:
        """CameraInfo with the header of an image message, if the camera is calibrated for images of its size."""
        self._header = image.header
        if self._plain is None:
            return
        size = _size_of(image)
        if size != self._size:
            with self._lock:
                self._size = size
                self._fit_info()
        if self._info is not None:
            self._send(image.header)

    def _fit_info(self) -> None:
        """The CameraInfo for images of the size that comes: the camera's, or one that divides it."""
        info = self._plain
        self._info = None
        if info is None:
            return
        fitting = info if self._size == (0, 0) else reduced(info, self._size)
        if fitting is not None:
            self._info = camera_info_message(fitting)
        if fitting is None or fitting is not info:
            width, height = self._size
            sizes = f"{width}×{height} pixels, its camera {info.width}×{info.height}"
            told = "no CameraInfo for them" if fitting is None else "CameraInfo has K and P for their size"
            self._tell_size(f"images of {self._camera.name} have {sizes}: {told}")

    def _tell_size(self, text: str) -> None:
        """Once: images of two sizes may take turns."""
        if text not in self._sizes_told and len(self._sizes_told) < _MOST_SIZES_TOLD:
            self._sizes_told.add(text)
            self._node.get_logger().warning(text)

    def check(self) -> None:
        """Make way for a driver whose CameraInfo has come later; call it now and then."""
        with self._lock:
            publisher = self._info_publisher
            wanted = self._node.resolve_topic_name(self._camera.camera_info_topic)
            if publisher is None or publisher.topic_name != wanted or self._node.count_publishers(wanted) < 2:
                return
            self._info_publisher = None  # the next image finds another topic
            self._node.destroy_publisher(publisher)

    def publish_pictures(self, header: Header, pictures: Pictures) -> None:
        if pictures.raw is not None:
            self._annotated.publish(picture_message(Picture(pictures.raw, "bgr8"), header))
        if pictures.compressed is not None:
            self._compressed.publish(compressed_message(pictures.compressed, header))

    def _send(self, header: Header) -> None:
        with self._lock:
            if self._info is None:
                return
            if self._info_publisher is None:  # not before the first image: only then its driver is surely known
                topic = self._info_topic()
                self._info_publisher = self._node.create_publisher(
                    CameraInfo, topic, LATCHED_STREAM, qos_overriding_options=overridden(self._node, topic, "publisher")
                )
            self._info.header = header
            self._info_publisher.publish(self._info)

    def _info_topic(self) -> str:
        """The configured topic, unless a driver publishes there: two would contradict each other."""
        wanted = self._node.resolve_topic_name(self._camera.camera_info_topic)
        if self._node.count_publishers(wanted) == 0:
            return str(wanted)
        own = self._node.resolve_topic_name(f"~/{self._camera.name}/camera_info")
        self._node.get_logger().warning(
            f"{wanted} has a publisher already, so CameraInfo goes to {own}; "
            "~/commit hands the calibration to the driver"
        )
        return str(own)


def _size_of(image: Any) -> tuple[int, int]:
    """(width, height) of an image message; (0, 0) where a compressed one does not tell."""
    if hasattr(image, "width"):
        return int(image.width), int(image.height)
    try:
        return declared_size(memoryview(image.data))
    except InputError:
        return 0, 0
