"""Publishes where the calibration stands: for dashboards as JSON, for rqt_robot_monitor as diagnostics."""

from __future__ import annotations

import json
from typing import Any

from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus, KeyValue
from rclpy.node import Node
from std_msgs.msg import String

from fisheye_ep_calib.live.status import Status
from fisheye_ep_calib.ros.quality import LATCHED
from fisheye_ep_calib.storage.json_text import json_text, plain


class StatusPublisher:
    """~/status (std_msgs/String, JSON, latched) and /diagnostics."""

    def __init__(self, node: Node) -> None:
        self._node = node
        self._status = node.create_publisher(String, "~/status", LATCHED)
        self._diagnostics = node.create_publisher(DiagnosticArray, "/diagnostics", 10)

    def publish(self, cameras: list[Status], rig: Status | None) -> None:
        content: dict[str, Any] = {"cameras": {camera.name: camera.as_dict() for camera in cameras}}
        if rig is not None:
            content["rig"] = rig.as_dict()
        self._status.publish(String(data=json_text(content)))
        array = DiagnosticArray(status=[self._diagnostic(status) for status in (*cameras, *filter(None, [rig]))])
        array.header.stamp = self._node.get_clock().now().to_msg()
        self._diagnostics.publish(array)

    def _diagnostic(self, status: Status) -> DiagnosticStatus:
        values = {**status.values, "next": status.next}
        return DiagnosticStatus(
            level=bytes([status.level]),
            name=f"{self._node.get_name()}: {status.name}",
            message=status.message,
            hardware_id=status.name,
            values=[KeyValue(key=key, value=_text(value)) for key, value in values.items()],
        )


def _text(value: Any) -> str:
    return value if isinstance(value, str) else json.dumps(plain(value))
