"""From observations to a calibrated camera, its uncertainty and what the data could not tell."""

from fisheye_ep_calib.calibration.calibrate import RoughCamera, calibrate, rough_camera
from fisheye_ep_calib.calibration.observations import Observations
from fisheye_ep_calib.calibration.options import Options
from fisheye_ep_calib.calibration.result import CalibrationResult

__all__ = ["CalibrationResult", "Observations", "Options", "RoughCamera", "calibrate", "rough_camera"]
