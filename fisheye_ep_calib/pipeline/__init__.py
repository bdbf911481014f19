"""The engine: from a recording to judged cameras; what every door calls."""

from fisheye_ep_calib.pipeline.calibrated_camera import CalibratedCamera
from fisheye_ep_calib.pipeline.calibrating import CalibratedCameras, calibrate_cameras, calibrate_recording
from fisheye_ep_calib.pipeline.camera_source import CameraSource
from fisheye_ep_calib.pipeline.looking import Look, Looking, camera_sources, looking

__all__ = [
    "CalibratedCamera",
    "CalibratedCameras",
    "CameraSource",
    "Look",
    "Looking",
    "calibrate_cameras",
    "calibrate_recording",
    "camera_sources",
    "looking",
]
