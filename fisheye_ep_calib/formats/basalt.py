"""Basalt's calibration JSON, as cereal reads it: T_imu_cam, intrinsics, resolution, and the IMU's values.

T_imu_cam is the IMU from the camera. No IMU is known here: the reference camera's frame stands in its place, and the
IMU's noise is a placeholder. (basalt-headers, calibration.hpp and camera/; doc/Calibration.md.)
"""

from __future__ import annotations

import json
from collections.abc import Sequence
from typing import Any

import numpy as np

from fisheye_ep_calib.camera import FisheyeCamera
from fisheye_ep_calib.formats.format import Format, Named, Written
from fisheye_ep_calib.formats.openvins import NO_IMU
from fisheye_ep_calib.formats.placed_camera import (
    KANNALA_BRANDT,
    PlacedCamera,
    floats,
    rotation_quaternion,
    statement,
)

PLACEHOLDERS: dict[str, Any] = {
    "calib_accel_bias": [0.0] * 9,
    "calib_gyro_bias": [0.0] * 12,
    "imu_update_rate": 200.0,
    "accel_noise_std": [0.016] * 3,
    "gyro_noise_std": [0.000282] * 3,
    "accel_bias_std": [0.001] * 3,
    "gyro_bias_std": [0.0001] * 3,
    "cam_time_offset_ns": 0,
    "mocap_time_offset_ns": 0,
    "mocap_to_imu_offset_ns": 0,
    "vignette": [],
}


def write(cameras: Sequence[PlacedCamera], _named: Named) -> Written:
    """kb4 cameras with one viewpoint, or ds where that is the lens."""
    central = [placed.central((KANNALA_BRANDT, "double_sphere")).camera for placed in cameras]
    words = (*statement(cameras, central), NO_IMU, "the IMU's biases and noise are placeholders")
    content = {
        "T_imu_cam": [_pose(placed.reference_from_camera) for placed in cameras],
        "intrinsics": [_intrinsics(camera) for camera in central],
        "resolution": [list(camera.image_size) for camera in central],
        **PLACEHOLDERS,
        "T_mocap_world": _pose(np.eye(4)),
        "T_imu_marker": _pose(np.eye(4)),
        "fisheye_ep_calib": list(words),  # cereal passes names over that it does not ask for
    }
    return Written({"": json.dumps({"value0": content}, indent=2) + "\n"}, words)


def _pose(pose: np.ndarray) -> dict[str, float]:
    names = ("px", "py", "pz", "qx", "qy", "qz", "qw")
    return dict(zip(names, [*floats(pose[:3, 3]), *rotation_quaternion(pose)], strict=True))


def _intrinsics(camera: FisheyeCamera) -> dict[str, Any]:
    grid = {name: float(getattr(camera, name)) for name in ("fx", "fy", "cx", "cy")}
    kind = "ds" if camera.lens == "double_sphere" else "kb4"
    radial = dict(zip(camera.lens_model.coefficient_names, floats(camera.radial), strict=True))
    return {"camera_type": kind, "intrinsics": {**grid, **radial}}


BASALT = Format("basalt", "Basalt's calibration JSON", write)
