"""Fisheye calibration with a moving entrance pupil."""

from fisheye_ep_calib.calibration import Observations
from fisheye_ep_calib.camera import FisheyeCamera
from fisheye_ep_calib.errors import CalibrationError, InputError

__all__ = ["CalibrationError", "FisheyeCamera", "InputError", "Observations"]
