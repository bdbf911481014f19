"""CameraInfo as plain data to the message."""

from __future__ import annotations

from sensor_msgs.msg import CameraInfo

from fisheye_ep_calib.storage.camera_info import PlainCameraInfo


def camera_info_message(info: PlainCameraInfo) -> CameraInfo:
    """A sensor_msgs/CameraInfo without its header."""
    return CameraInfo(
        width=info.width,
        height=info.height,
        distortion_model=info.distortion_model,
        d=[float(value) for value in info.d],
        k=[float(value) for value in info.k],
        r=[float(value) for value in info.r],
        p=[float(value) for value in info.p],
    )
