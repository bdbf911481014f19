"""Hands a calibration to the camera's driver by its service set_camera_info."""

from __future__ import annotations

import time
from collections.abc import Callable

from rclpy.callback_groups import MutuallyExclusiveCallbackGroup
from rclpy.node import Node
from sensor_msgs.srv import SetCameraInfo

from fisheye_ep_calib.live.answer import Answer
from fisheye_ep_calib.live.outcome import Outcome
from fisheye_ep_calib.live.settings import CameraSettings
from fisheye_ep_calib.ros.messages import camera_info_message
from fisheye_ep_calib.ros.patient_node import PatientNode

PATIENCE = 5.0  # seconds for the drivers to be there, and for each one's answer
_LOOK = 0.02  # seconds between looks whether it is there or has answered


class DriverCommit:
    """One camera's driver. Waits, so it must not run where images are received."""

    def __init__(self, patient: PatientNode, node: Node, camera: CameraSettings) -> None:
        """patient: the node that may wait. node: by whose name and remappings the service is found."""
        self._stopping = patient.stopping
        self._camera = camera
        self._service = node.resolve_service_name(camera.set_camera_info_service)
        group = MutuallyExclusiveCallbackGroup()  # answers must arrive while a service callback waits for them
        self._client = patient.node.create_client(SetCameraInfo, self._service, callback_group=group)

    def commit(self, outcome: Outcome | None, give_up: float) -> Answer:
        """Call the driver and tell what it said. give_up: until when to wait for it to be there, by time.monotonic."""
        name = self._camera.name
        if outcome is None:
            return Answer(False, f"{name}: not calibrated yet")
        if not self._wait(self._client.service_is_ready, give_up):
            return Answer(
                False,
                f"{name}: nobody serves {self._service}: start the driver, or set the parameter "
                f"{name}.set_camera_info, and call ~/commit again",
            )
        future = self._client.call_async(SetCameraInfo.Request(camera_info=camera_info_message(outcome.info)))
        if not self._wait(future.done, time.monotonic() + PATIENCE):
            self._client.remove_pending_request(future)
            return Answer(False, f"{name}: {self._service} did not answer in {PATIENCE:.0f} s")
        response = future.result()
        if not response.success:
            return Answer(False, f"{name}: {self._service} refused: {response.status_message or 'no reason given'}")
        model = outcome.figures["model"]
        return Answer(True, f"{name}: {self._service} took the stand-in of {model} ({response.status_message})")

    def _wait(self, condition: Callable[[], bool], give_up: float) -> bool:
        while not condition():
            if time.monotonic() > give_up or self._stopping.wait(_LOOK):
                return False
        return True
