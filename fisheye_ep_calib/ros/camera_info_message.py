"""CameraInfo as plain data to the message."""

from __future__ import annotations

from dataclasses import asdict

from sensor_msgs.msg import CameraInfo

from fisheye_ep_calib.camera.camera_info import PlainCameraInfo


def camera_info_message(info: PlainCameraInfo) -> CameraInfo:
    """A sensor_msgs/CameraInfo without its header."""
    return CameraInfo(**asdict(info))
