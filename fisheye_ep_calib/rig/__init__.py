"""Cameras that see one target at the same time: where they are to each other."""

from fisheye_ep_calib.rig.calibrate import USUAL_TOLERANCE, RigCamera, calibrate_rig
from fisheye_ep_calib.rig.result import RigCalibration, RigPair
from fisheye_ep_calib.rig.synchronisation import stamps_of_names
from fisheye_ep_calib.rig.triangulation import rays_in, triangulate

__all__ = [
    "USUAL_TOLERANCE",
    "RigCalibration",
    "RigCamera",
    "RigPair",
    "calibrate_rig",
    "rays_in",
    "stamps_of_names",
    "triangulate",
]
