"""One camera's images, received with the quality of service that their publisher offers."""

from __future__ import annotations

import time
from collections.abc import Callable
from functools import partial
from typing import Any

from rclpy.callback_groups import MutuallyExclusiveCallbackGroup
from rclpy.node import Node
from rclpy.qos import HistoryPolicy, QoSProfile, ReliabilityPolicy
from rclpy.qos_overriding_options import InvalidQosOverridesError, QoSOverridingOptions
from rclpy.subscription import Subscription
from rclpy.topic_endpoint_info import TopicEndpointInfo
from sensor_msgs.msg import CompressedImage, Image

from fisheye_ep_calib.errors import first_line
from fisheye_ep_calib.live.status import Reception
from fisheye_ep_calib.ros.quality import overridden

SILENCE = 5.0  # seconds without a publisher or an image after which the user is told
QUEUE_DEPTH = 10  # large reliable images are lost with less; they are taken out at once, so it stays empty


class ImageIntake:
    """Subscribes once a publisher is there, and anew when what it offers changes."""

    def __init__(self, node: Node, topic: str, compressed: bool, on_image: Callable[[Any], None]) -> None:
        """on_image: called with each message; must return at once."""
        self._node = node
        self._topic = topic
        self._type = CompressedImage if compressed else Image
        self._on_image = on_image
        self._group = MutuallyExclusiveCallbackGroup()
        self._subscription: Subscription | None = None
        self._reliability: ReliabilityPolicy | None = None
        self._last_image = time.monotonic()
        self._last_stamp = 0
        self._went_back = False
        self._delay: float | None = None
        self._largest_delay: float | None = None
        self._told = ""

    @property
    def name(self) -> str:
        """The topic as ROS resolved it."""
        return str(self._node.resolve_topic_name(self._topic))

    def reception(self) -> Reception:
        """How images arrive; the largest delay is that since the last call."""
        largest, self._largest_delay = self._largest_delay, None
        silent = time.monotonic() - self._last_image > SILENCE
        return Reception(self.name, silent, self._delay, largest)

    def check(self) -> None:
        """Look for publishers and for silence; call it every second or so."""
        publishers = self._node.get_publishers_info_by_topic(self._topic)
        type_name = f"sensor_msgs/msg/{self._type.__name__}"
        fitting = [publisher for publisher in publishers if publisher.topic_type == type_name]
        if fitting:
            self._subscribe(_reliability(fitting))
        if time.monotonic() - self._last_image > SILENCE:
            self._say(_silence(self.name, type_name, publishers, bool(fitting)))

    def _subscribe(self, reliability: ReliabilityPolicy) -> None:
        if self._subscription is not None:
            if self._reliability == reliability:
                return
            self._node.destroy_subscription(self._subscription)
        self._reliability = reliability
        quality = QoSProfile(history=HistoryPolicy.KEEP_LAST, depth=QUEUE_DEPTH, reliability=reliability)
        self._subscription = self._created(quality, overridden(self._node, self.name, "subscription"))
        used = quality.reliability.name.lower().replace("_", " ")
        self._node.get_logger().info(f"receiving {self.name} ({used})")

    def _created(self, quality: QoSProfile, changes: QoSOverridingOptions | None) -> Subscription:
        """A subscription; with qos_overrides that can be used, ``quality`` becomes what they make of it."""
        create = partial(self._node.create_subscription, self._type, self._topic, self._receive, quality)
        try:
            return create(callback_group=self._group, qos_overriding_options=changes)
        except (RuntimeError, TypeError, ValueError, InvalidQosOverridesError) as error:
            if changes is None:
                raise
            self._node.get_logger().error(f"qos_overrides of {self.name} are not used: {first_line(error)}")
            return create(callback_group=self._group)

    def _receive(self, message: Any) -> None:
        self._last_image = time.monotonic()
        if self._told:
            self._told = ""
            self._node.get_logger().info(f"images on {self.name} again")
        stamp = message.header.stamp.sec * 10**9 + message.header.stamp.nanosec
        if stamp < self._last_stamp and not self._went_back:
            self._went_back = True
            self._node.get_logger().warning(
                f"the stamps on {self.name} went back (a bag in a loop, or simulated time); going on"
            )
        self._last_stamp = stamp
        delay = (self._node.get_clock().now().nanoseconds - stamp) * 1e-9
        self._delay = delay
        self._largest_delay = max(delay, self._largest_delay or delay)
        self._on_image(message)

    def _say(self, text: str) -> None:
        if text != self._told:
            self._told = text
            self._node.get_logger().warning(text)


def _reliability(publishers: list[TopicEndpointInfo]) -> ReliabilityPolicy:
    """Reliable where every publisher is, because large images are lost otherwise; else what all can serve."""
    if all(publisher.qos_profile.reliability == ReliabilityPolicy.RELIABLE for publisher in publishers):
        return ReliabilityPolicy.RELIABLE
    return ReliabilityPolicy.BEST_EFFORT


def _silence(topic: str, type_name: str, publishers: list[TopicEndpointInfo], fitting: bool) -> str:
    if fitting:
        return f"no image on {topic} for {SILENCE:.0f} s; waiting"
    if publishers:
        other = publishers[0].topic_type
        return f"{topic} carries {other}, not {type_name}: see the parameters topic and transport; waiting"
    return f"nobody publishes {topic}; waiting"
