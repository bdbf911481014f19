"""CameraInfo as plain data: what consumers of a camera with one viewpoint get, as fields and as a file's keys."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, replace
from typing import Any

from fisheye_ep_calib.camera.fisheye import FisheyeCamera

_UNTURNED = (1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0)


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
    focal, centre = (stand_in.fx, stand_in.fy), (stand_in.cx, stand_in.cy)
    return _camera_info(stand_in.image_size, "equidistant", stand_in.radial, focal, centre)


def pinhole_camera_info(size: tuple[int, int], focal_length: float, centre: tuple[float, float]) -> PlainCameraInfo:
    """CameraInfo of a pinhole without distortion; size (width, height), focal length and centre in px."""
    return _camera_info(size, "plumb_bob", (0.0,) * 5, (focal_length, focal_length), centre)


def uncalibrated_camera_info(size: tuple[int, int], distortion_model: str) -> PlainCameraInfo:
    """Zeros, which say "uncalibrated", for what no CameraInfo describes: nobody must take it for a pinhole's."""
    return PlainCameraInfo(size[0], size[1], distortion_model, (), (0.0,) * 9, _UNTURNED, (0.0,) * 12)


def _camera_info(
    size: tuple[int, int],
    distortion_model: str,
    distortion: Iterable[float],
    focal_lengths: Iterable[float],
    centre: Iterable[float],
) -> PlainCameraInfo:
    (fx, fy), (cx, cy) = map(float, focal_lengths), map(float, centre)
    k = (fx, 0.0, cx, 0.0, fy, cy, 0.0, 0.0, 1.0)
    p = (fx, 0.0, cx, 0.0, 0.0, fy, cy, 0.0, 0.0, 0.0, 1.0, 0.0)
    width, height = size
    return PlainCameraInfo(width, height, distortion_model, tuple(map(float, distortion)), k, _UNTURNED, p)


def camera_info_content(info: PlainCameraInfo, name: str) -> dict[str, Any]:
    """The keys and values of camera_info_manager's YAML, in its order."""
    return {
        "image_width": int(info.width),
        "image_height": int(info.height),
        "camera_name": str(name),
        "camera_matrix": _matrix(3, 3, info.k),
        "distortion_model": info.distortion_model,
        "distortion_coefficients": _matrix(1, len(info.d), info.d),
        "rectification_matrix": _matrix(3, 3, info.r),
        "projection_matrix": _matrix(3, 4, info.p),
    }


def _matrix(rows: int, columns: int, values: Iterable[float]) -> dict[str, Any]:
    return {"rows": rows, "cols": columns, "data": [float(value) for value in values]}


def reduced(info: PlainCameraInfo, size: tuple[int, int]) -> PlainCameraInfo | None:
    """The CameraInfo of images whose pixels are means of n × n of the camera's; None where size is not such a one.

    K and P are for that size, D is the same: f/n and (c + ½)/n − ½, as the centre of a pixel is its middle. Binning is
    not used: a consumer that does not read it is right too.
    """
    number = round(info.width / max(size[0], 1))
    if number < 1 or (info.width // number, info.height // number) != tuple(size):
        return None
    if number == 1:
        return info

    def grid(values: tuple[float, ...], columns: int) -> tuple[float, ...]:
        rows = [values[start : start + columns] for start in range(0, len(values), columns)]
        centred = [[*rows[row][:2], rows[row][2] + 0.5, *rows[row][3:]] for row in range(2)]
        scaled = [[value / number for value in row] for row in centred]
        return (*(v - 0.5 * (i == 2) for row in scaled for i, v in enumerate(row)), *rows[2])

    return replace(info, width=size[0], height=size[1], k=grid(info.k, 3), p=grid(info.p, 4))
