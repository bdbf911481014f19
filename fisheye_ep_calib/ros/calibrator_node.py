"""The calibrator node: parameters in, images in, services, and each camera's calibration out."""

from __future__ import annotations

import time
from functools import partial
from typing import Any

from rclpy.clock import Clock, ClockType
from rclpy.parameter import Parameter
from std_msgs.msg import String

from fisheye_ep_calib.errors import CalibrationError
from fisheye_ep_calib.live.answer import Answer, together
from fisheye_ep_calib.live.calibrator import LiveCalibrator
from fisheye_ep_calib.live.outcome import Outcome
from fisheye_ep_calib.live.overlay import Pictures
from fisheye_ep_calib.live.rig_outcome import RigOutcome
from fisheye_ep_calib.live.settings import CameraSettings
from fisheye_ep_calib.ros.calibration_publisher import CalibrationPublisher
from fisheye_ep_calib.ros.calibrator_parameters import declare, tuning, web
from fisheye_ep_calib.ros.driver_commit import PATIENCE, DriverCommit
from fisheye_ep_calib.ros.image_intake import ImageIntake
from fisheye_ep_calib.ros.node_announcer import announcer_of
from fisheye_ep_calib.ros.parameter_names import with_parameters
from fisheye_ep_calib.ros.parameter_table import ParameterTable, node_with_what_was_given
from fisheye_ep_calib.ros.patient_node import PatientNode, VisibleNode
from fisheye_ep_calib.ros.quality import LATCHED
from fisheye_ep_calib.ros.rig_transforms import RigTransforms
from fisheye_ep_calib.ros.status_publisher import StatusPublisher
from fisheye_ep_calib.web.content import PageContent
from fisheye_ep_calib.web.server import PageServer
from fisheye_ep_calib.web.settings import WebSettings

CHECK_PERIOD = 0.5  # seconds between looks at who publishes what
STATUS_PERIOD = 1.0
RETRY_PERIOD = 5.0  # seconds between attempts to write what the disk refused


class CalibratorNode:
    """Wires a ROS node to a LiveCalibrator; image callbacks only hand messages over."""

    def __init__(self) -> None:
        """Raises InputError for parameters or files that cannot be used."""
        self.node: VisibleNode = node_with_what_was_given("calibrator", VisibleNode)
        self._patient = PatientNode(self.node)
        self._live: LiveCalibrator | None = None
        self._page: PageServer | None = None
        try:
            self._start()
        except BaseException:
            self.close()
            raise

    def close(self) -> None:
        """End workers and write what is not written; the node is of no use afterwards."""
        self._patient.stopping.set()
        if self._page is not None:
            self._page.stop()
        live, self._live = self._live, None
        if live is not None:
            live.stop()
        self._patient.close()
        self.node.destroy_node()

    def _start(self) -> None:
        self._parameters = ParameterTable(self.node)
        settings = declare(self._parameters)
        self._parameters.warn_of_unknown()
        cameras = settings.cameras
        self._publishers = {camera.name: CalibrationPublisher(self.node, camera) for camera in cameras}
        for camera in cameras:
            self._publishers[camera.name].update(camera.initial)
        self._drivers = {camera.name: DriverCommit(self._patient, self.node, camera) for camera in cameras}
        self._status = StatusPublisher(self.node)
        self._rig = self.node.create_publisher(String, "~/rig", LATCHED) if settings.rig else None
        self._transforms = RigTransforms(self.node) if settings.rig and self._parameters["rig_tf"] else None
        announcer = announcer_of(self.node)
        self._live = live = LiveCalibrator(settings, tuning(self._parameters), announcer, self)
        self._intakes = {camera.name: self._intake(live, camera) for camera in cameras}
        self.node.add_post_set_parameters_callback(lambda changed: self._retune(live, changed))
        self._patient.serve("calibrate", live.calibrate, together=True)
        self._patient.serve("save", live.save)
        self._patient.serve("reset", live.reset)
        self._patient.serve("commit", lambda: self._commit(live))
        for name in self._drivers:
            self._patient.serve(f"{name}/commit", partial(self._commit, live, name))
            if name in live.cameras:
                self._patient.serve(f"{name}/reset", partial(live.reset, name))
        self._patient.every(RETRY_PERIOD, live.retry_writing)
        self._patient.every(STATUS_PERIOD, lambda: self._publish_status(live))
        self._page = self._serve_page(live, web(self._parameters))
        self._patient.start()
        steady = Clock(clock_type=ClockType.STEADY_TIME)
        self.node.create_timer(CHECK_PERIOD, self._check_intakes, clock=steady)

    def calibrated(self, camera: str, outcome: Outcome | None) -> None:
        self._publishers[camera].update(outcome)

    def rig_calibrated(self, outcome: RigOutcome | None) -> None:
        if self._rig is not None:
            self._rig.publish(String(data="" if outcome is None else outcome.yaml))
        if self._transforms is not None:
            frames = {name: publisher.frame for name, publisher in self._publishers.items()}
            self._transforms.publish(None if outcome is None else outcome.figures, frames)

    def wanted_pictures(self, camera: str) -> frozenset[str]:
        watched = self._publishers[camera].watched
        return watched | {"page"} if self._page is not None and self._page.watched(camera) else watched

    def pictures(self, camera: str, header: Any, pictures: Pictures) -> None:
        self._publishers[camera].publish_pictures(header, pictures)
        if self._page is not None and pictures.page is not None:
            self._page.show(camera, pictures.page)

    def _intake(self, live: LiveCalibrator, camera: CameraSettings) -> ImageIntake:
        publisher = self._publishers[camera.name]

        def receive(message: Any) -> None:
            publisher.publish_info(message)
            stamp = message.header.stamp
            live.offer(camera.name, message, f"{stamp.sec}.{stamp.nanosec:09d}")

        return ImageIntake(self.node, camera.image_topic, camera.compressed, receive)

    def _serve_page(self, live: LiveCalibrator, settings: WebSettings | None) -> PageServer | None:
        logger = self.node.get_logger()
        if settings is None:
            return None
        content = PageContent(live, partial(self._commit, live), self.node.get_name())
        try:
            return PageServer(content, settings, logger.info)
        except CalibrationError as error:
            logger.warning(with_parameters(f"no page to look at: {error}"))
            return None

    def _commit(self, live: LiveCalibrator, only: str | None = None) -> Answer:
        give_up = time.monotonic() + PATIENCE
        drivers = {name: driver for name, driver in self._drivers.items() if only in (None, name)}
        return together([driver.commit(live.outcome(name), give_up) for name, driver in drivers.items()])

    def _retune(self, live: LiveCalibrator, changed: list[Parameter]) -> None:
        if any(self._parameters.is_live(parameter.name) for parameter in changed):
            live.tune(tuning(self._parameters))

    def _check_intakes(self) -> None:
        for intake in self._intakes.values():
            intake.check()
        for publisher in self._publishers.values():
            publisher.check()

    def _publish_status(self, live: LiveCalibrator) -> None:
        cameras = live.status({name: intake.reception() for name, intake in self._intakes.items()})
        rig = live.rig_status()
        self._status.publish(cameras, rig)
        if self._page is not None:
            self._page.content.update(cameras, rig)
