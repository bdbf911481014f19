"""CameraInfo as plain data: what consumers of a single-viewpoint camera get."""

from __future__ import annotations

from dataclasses import dataclass

from fisheye_ep_calib.camera import FisheyeCamera


@dataclass(frozen=True)
class PlainCameraInfo:
    """The fields of sensor_msgs/CameraInfo. k, r: 3×3 row by row; p: 3×4; d: k1..k4 of ``equidistant``."""

    width: int
    height: int
    distortion_model: str
    d: tuple[float, ...]
    k: tuple[float, ...]
    r: tuple[float, ...]
    p: tuple[float, ...]


def plain_camera_info(stand_in: FisheyeCamera) -> PlainCameraInfo:
    """CameraInfo of a central Kannala–Brandt camera without skew; P = [K | 0], R = I."""
    fx, fy, cx, cy = (float(value) for value in (stand_in.fx, stand_in.fy, stand_in.cx, stand_in.cy))
    width, height = stand_in.image_size
    return PlainCameraInfo(
        width,
        height,
        "equidistant",
        tuple(float(value) for value in stand_in.radial),
        (fx, 0.0, cx, 0.0, fy, cy, 0.0, 0.0, 1.0),
        (1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0),
        (fx, 0.0, cx, 0.0, 0.0, fy, cy, 0.0, 0.0, 0.0, 1.0, 0.0),
    )
