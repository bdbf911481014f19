"""From observations to a calibrated camera, its uncertainty and what the data could not tell."""

from fisheye_ep_calib.calibration.observations import Observations

__all__ = ["Observations"]
