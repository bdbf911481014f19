"""The calibrator node: parameters in, images in, services, and each camera's calibration out."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from rclpy.callback_groups import MutuallyExclusiveCallbackGroup
from rclpy.clock import Clock, ClockType
from rclpy.node import Node
from rclpy.parameter import Parameter
from std_srvs.srv import Trigger

from fisheye_ep_calib.live.announcer import Announcer
from fisheye_ep_calib.live.calibrator import Answer, LiveCalibrator
from fisheye_ep_calib.live.outcome import Outcome
from fisheye_ep_calib.live.settings import CameraSettings
from fisheye_ep_calib.ros.calibration_publisher import CalibrationPublisher
from fisheye_ep_calib.ros.calibrator_parameters import declare, tuning
from fisheye_ep_calib.ros.image_intake import ImageIntake
from fisheye_ep_calib.ros.parameter_table import ParameterTable

CHECK_PERIOD = 0.5  # seconds between looks at who publishes what
RETRY_PERIOD = 5.0  # seconds between attempts to write what the disk refused


class CalibratorNode:
    """Wires a ROS node to a LiveCalibrator; image callbacks only hand messages over."""

    def __init__(self) -> None:
        """Raises InputError for parameters or files that cannot be used."""
        self.node = Node("calibrator")
        self._live: LiveCalibrator | None = None
        try:
            self._start()
        except BaseException:
            self.close()
            raise

    def close(self) -> None:
        """End workers and write what is not written; the node is of no use afterwards."""
        live, self._live = self._live, None
        if live is not None:
            live.stop()
        self.node.destroy_node()

    def _start(self) -> None:
        self._parameters = ParameterTable(self.node)
        settings = declare(self._parameters)
        logger = self.node.get_logger()
        for name in self._parameters.unknown():
            logger.warning(f"parameter {name} is not known and has no effect")
        announcer = Announcer(logger.info, logger.warning)
        self._publishers = {
            camera.name: CalibrationPublisher(self.node, camera) for camera in settings.cameras
        }
        for camera in settings.cameras:
            self._publishers[camera.name].update(camera.initial)
        self._live = LiveCalibrator(settings, tuning(self._parameters), announcer, self._publish)
        self._intakes = [self._intake(camera) for camera in settings.cameras]
        self.node.add_post_set_parameters_callback(self._retune)
        for name in ("calibrate", "save", "reset"):
            self._serve(name, getattr(self._live, name))
        # Steady time: simulated time may stand still or jump back.
        self._steady = Clock(clock_type=ClockType.STEADY_TIME)
        self._every(CHECK_PERIOD, self._check_intakes)
        self._every(RETRY_PERIOD, self._live.retry_writing)

    def _intake(self, camera: CameraSettings) -> ImageIntake:
        live, publisher = self._live, self._publishers[camera.name]
        assert live is not None

        def receive(message: Any) -> None:
            publisher.publish_info(message)
            stamp = message.header.stamp
            live.offer(camera.name, message, f"{stamp.sec}.{stamp.nanosec:09d}")

        return ImageIntake(self.node, camera.image_topic, camera.compressed, receive)

    def _publish(self, camera: str, outcome: Outcome | None) -> None:
        self._publishers[camera].update(outcome)

    def _retune(self, parameters: list[Parameter]) -> None:
        if self._live is not None:
            self._live.tune(tuning(self._parameters))

    def _check_intakes(self) -> None:
        for intake in self._intakes:
            intake.check()

    def _serve(self, name: str, action: Callable[[], Answer]) -> None:
        """A Trigger service; each has a thread of its own, because answers may take a while."""

        def answer(_request: Trigger.Request, response: Trigger.Response) -> Trigger.Response:
            done = action()
            response.success, response.message = done.success, done.text
            return response

        self.node.create_service(Trigger, f"~/{name}", answer, callback_group=MutuallyExclusiveCallbackGroup())

    def _every(self, seconds: float, action: Callable[[], None]) -> None:
        group = MutuallyExclusiveCallbackGroup()
        self.node.create_timer(seconds, action, callback_group=group, clock=self._steady)
