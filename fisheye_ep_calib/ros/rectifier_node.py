"""The rectifier node: fisheye images in, images with a single viewpoint and their CameraInfo out."""

from __future__ import annotations

from typing import Any

import numpy as np
from rclpy.clock import Clock, ClockType
from sensor_msgs.msg import CameraInfo, Image
from std_msgs.msg import Header

from fisheye_ep_calib.errors import InputError
from fisheye_ep_calib.rectification import rectified_camera_info
from fisheye_ep_calib.ros.image_intake import ImageIntake
from fisheye_ep_calib.ros.latest_worker import LatestWorker
from fisheye_ep_calib.ros.messages import camera_info_message, picture_message
from fisheye_ep_calib.ros.node_announcer import announcer_of
from fisheye_ep_calib.ros.parameter_table import ParameterTable, node_with_what_was_given
from fisheye_ep_calib.ros.rectifier_parameters import declare, distance
from fisheye_ep_calib.storage.pictures import Picture, decode_compressed_picture, decode_depth, decode_picture

CHECK_PERIOD = 0.5  # seconds between looks at who publishes what
CALM = 5.0  # seconds without an image that cannot be used, before all is said to be well again
PREPARE = object()  # offered before the first image


class RectifierNode:
    """Image callbacks only hand messages over; one thread rectifies the latest."""

    def __init__(self) -> None:
        """Raises InputError for parameters or files that cannot be used."""
        self.node = node_with_what_was_given("rectifier")
        self._worker: LatestWorker | None = None
        try:
            self._start()
        except BaseException:
            self.close()
            raise

    def close(self) -> None:
        """End the thread; the node is of no use afterwards."""
        worker, self._worker = self._worker, None
        if worker is not None:
            worker.close()
            self.node.get_logger().info(
                f"{self._rectified} images rectified, {self._unusable} could not be, {worker.dropped} came too fast"
            )
        self.node.destroy_node()

    def _start(self) -> None:
        self._parameters = ParameterTable(self.node)
        self._settings = settings = declare(self._parameters)
        logger = self.node.get_logger()
        self._parameters.warn_of_unknown()
        self._announcer = announcer_of(self.node)
        self._rectifier = settings.rectifier
        self._info = camera_info_message(rectified_camera_info(self._rectifier.view))
        self._images = self.node.create_publisher(Image, f"{settings.output}/image_rect", 5)
        self._infos = self.node.create_publisher(CameraInfo, f"{settings.output}/camera_info", 5)
        self._distance = distance(self._parameters)
        self._depth: Any = None
        self._depth_used: tuple[Any, np.ndarray | None] = (None, None)
        self._rectified = self._unusable = 0
        self.node.add_post_set_parameters_callback(lambda _: self._retune())
        self._worker = worker = LatestWorker(self._work)
        worker.offer(PREPARE)
        self._intakes = [ImageIntake(self.node, settings.image_topic, settings.compressed, worker.offer)]
        if settings.depth_topic:
            self._intakes.append(ImageIntake(self.node, settings.depth_topic, False, self._take_depth))
        self.node.create_timer(CHECK_PERIOD, self._check_intakes, clock=Clock(clock_type=ClockType.STEADY_TIME))
        width, height = self._rectifier.view.size
        logger.info(f"publishing {self._images.topic_name}, {width}×{height}, {self._rectifier.view.projection}")

    def _retune(self) -> None:
        self._distance = distance(self._parameters)

    def _check_intakes(self) -> None:
        for intake in self._intakes:
            intake.check()

    def _take_depth(self, message: Any) -> None:
        self._depth = message

    def _work(self, message: Any) -> None:
        """In the worker's thread."""
        try:
            if message is PREPARE:
                self._rectifier.maps(self._distance)
            else:
                self._rectify(message)
        except Exception as error:  # whatever one image holds, the next one is looked at
            if not self.node.context.ok():
                return  # interrupted: nothing can be published any more
            self._unusable += 1
            text = str(error) if isinstance(error, InputError) else f"{type(error).__name__}: {error}"
            self._announcer.warn_once("image", f"an image cannot be rectified: {text.splitlines()[0]}")

    def _rectify(self, message: Any) -> None:
        header = Header(stamp=message.header.stamp, frame_id=self._frame_id(message.header.frame_id))
        if self._images.get_subscription_count() > 0:
            decode = decode_compressed_picture if self._settings.compressed else decode_picture
            picture = decode(message)
            samples = self._rectifier.rectify(picture.samples, self._distance, self._depth_for(message))
            self._images.publish(picture_message(Picture(samples, picture.encoding), header))
            self._rectified += 1
            self._announcer.over("image", "images can be rectified again", CALM)
        if self._infos.get_subscription_count() > 0:
            self._info.header = header
            self._infos.publish(self._info)

    def _frame_id(self, of_image: str) -> str:
        view = self._rectifier.view
        if self._settings.frame_id or not (view.yaw or view.pitch):
            return self._settings.frame_id or of_image
        turned = f"{of_image}_rectified"
        x, y, z, w = _quaternion(view.yaw, view.pitch)
        self._announcer.warn_once(
            f"frame {turned}",
            f"the view is turned and has a frame of its own; for transforms run: ros2 run tf2_ros "
            f"static_transform_publisher --frame-id {of_image} --child-frame-id {turned} "
            f"--qx {x:.9f} --qy {y:.9f} --qz {z:.9f} --qw {w:.9f}",
        )
        return turned

    def _depth_for(self, message: Any) -> np.ndarray | None:
        """The latest depth image, if there is one near enough in time and readable."""
        depth = self._depth
        if not self._settings.depth_topic:
            return None
        if depth is None or abs(_seconds(depth) - _seconds(message)) > self._settings.depth_age:
            self._announcer.warn_once("depth", "no depth image for this time; the distance is used instead")
            return None
        if self._depth_used[0] is not depth:
            self._depth_used = depth, self._decoded(depth)
        if self._depth_used[1] is not None:
            self._announcer.over("depth", "depth images are used", CALM)
        return self._depth_used[1]

    def _decoded(self, depth: Any) -> np.ndarray | None:
        try:
            return decode_depth(depth)
        except InputError as error:
            self._announcer.warn_once("depth", f"{error}; the distance is used instead")
            return None


def _seconds(message: Any) -> float:
    return float(message.header.stamp.sec + 1e-9 * message.header.stamp.nanosec)


def _quaternion(yaw: float, pitch: float) -> tuple[float, float, float, float]:
    """x, y, z, w of R_y(yaw) R_x(pitch)."""
    sine_yaw, cosine_yaw = np.sin(yaw / 2), np.cos(yaw / 2)
    sine_pitch, cosine_pitch = np.sin(pitch / 2), np.cos(pitch / 2)
    return cosine_yaw * sine_pitch, sine_yaw * cosine_pitch, -sine_yaw * sine_pitch, cosine_yaw * cosine_pitch
