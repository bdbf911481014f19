"""A camera with what is known about it, whatever it is given as."""

from __future__ import annotations

from os import PathLike

import numpy as np

from fisheye_ep_calib.calibration import CalibrationResult
from fisheye_ep_calib.calibration.assessing.stand_in import single_viewpoint
from fisheye_ep_calib.calibration.content import calibration_content
from fisheye_ep_calib.camera import FisheyeCamera
from fisheye_ep_calib.storage.camera_file import read_camera_file
from fisheye_ep_calib.storage.camera_file_parsing import CameraFile

AnyCamera = FisheyeCamera | CalibrationResult | CameraFile | str | PathLike[str]


def known_camera(camera: AnyCamera) -> CameraFile:
    """camera: a camera alone, a calibration, a camera file or its path. Raises InputError where it cannot be read."""
    if isinstance(camera, CameraFile):
        return camera
    if isinstance(camera, CalibrationResult):
        return _of_result(camera)
    if isinstance(camera, FisheyeCamera):
        stand_in = single_viewpoint(camera)
        unknown = np.zeros((len(camera.parameters),) * 2)
        return CameraFile("camera", camera, stand_in.camera, unknown, stand_in.distance, stand_in.loss_px)
    return read_camera_file(camera)


def _of_result(result: CalibrationResult) -> CameraFile:
    stand_in, table = result.stand_in, result.projection_table
    return CameraFile(
        getattr(result, "name", "camera"),
        result.camera,
        stand_in.camera,
        result.uncertainty.covariance,
        stand_in.distance,
        stand_in.loss_px,
        result.board_warp,
        calibration_content(result, ("rms_px", "noise_px", "views")),
        {
            "theta_deg": table.theta_deg.tolist(),
            "distance_m": table.distance_m.tolist(),
            "sigma_px": table.sigma_px.tolist(),
        },
        result.board,
    )
