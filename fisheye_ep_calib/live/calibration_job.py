"""The calibration of one camera's views, as a worker process runs it."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

from fisheye_ep_calib.calibration import Observations, calibrate
from fisheye_ep_calib.storage.camera_file import camera_yaml
from fisheye_ep_calib.storage.camera_info import PlainCameraInfo, camera_info


@dataclass(frozen=True)
class Outcome:
    """A CalibrationResult, the camera's YAML and its CameraInfo."""

    result: Any
    yaml: str
    info: PlainCameraInfo


def calibrate_views(observations: Observations, model: str, name: str) -> Outcome:
    """Calibrate camera ``name``. Raises CalibrationError."""
    result = calibrate(observations, model=model)
    return Outcome(result, camera_yaml(result, name), camera_info(result.camera))
