"""The engine: from a recording to judged cameras; what every door calls."""

from fisheye_ep_calib.pipeline.calibrated_camera import CalibratedCamera, calibrate_observations
from fisheye_ep_calib.pipeline.calibrating import CalibratedCameras, calibrate_cameras, calibrate_recording
from fisheye_ep_calib.pipeline.camera_source import CameraSource
from fisheye_ep_calib.pipeline.compared_cameras import ComparedCameras, compare
from fisheye_ep_calib.pipeline.evaluated_camera import EvaluatedCamera, evaluate
from fisheye_ep_calib.pipeline.exporting import Exported, export
from fisheye_ep_calib.pipeline.looking import Look, Looking, camera_sources, find_target, looking

__all__ = [
    "CalibratedCamera",
    "CalibratedCameras",
    "CameraSource",
    "ComparedCameras",
    "EvaluatedCamera",
    "Exported",
    "Look",
    "Looking",
    "calibrate_cameras",
    "calibrate_observations",
    "calibrate_recording",
    "camera_sources",
    "compare",
    "evaluate",
    "export",
    "find_target",
    "looking",
]
