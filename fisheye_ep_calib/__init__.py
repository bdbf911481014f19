"""Fisheye calibration with a moving entrance pupil."""

from fisheye_ep_calib.calibration import CalibrationResult, Observations, calibrate
from fisheye_ep_calib.camera import FisheyeCamera
from fisheye_ep_calib.errors import CalibrationError, InputError
from fisheye_ep_calib.storage.camera_file import load_camera, save_camera

__all__ = [
    "CalibrationError",
    "CalibrationResult",
    "FisheyeCamera",
    "InputError",
    "Observations",
    "calibrate",
    "load_camera",
    "save_camera",
]
