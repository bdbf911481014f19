"""A camera file as plain data, for programs."""

from __future__ import annotations

from typing import Any

import numpy as np

from fisheye_ep_calib.camera.bands import pupil_sigma, radius_sigma
from fisheye_ep_calib.storage.camera_file import CameraFile


def camera_content(file: CameraFile) -> dict[str, Any]:
    """What there is to say of a camera file: ``show --json``. Curves are told at whole degrees up to theta_max."""
    camera, covariance = file.camera, file.covariance
    degrees = np.arange(int(np.floor(np.degrees(camera.theta_max) + 1e-9)) + 1)
    theta = np.radians(degrees)
    sigma = np.sqrt(np.maximum(np.diag(covariance), 0))
    return {
        "name": file.name,
        "model": camera.model,
        "lens": camera.lens,
        "image_size": list(camera.image_size),
        "fx": camera.fx,
        "fy": camera.fy,
        "skew": camera.skew,
        "cx": camera.cx,
        "cy": camera.cy,
        "radial": list(camera.radial),
        **{name: list(values) for name, values in camera.extras.items()},
        "coefficients": list(camera.coefficients),
        "theta_max_deg": float(np.degrees(camera.theta_max)),
        "parameters": list(camera.parameter_names),
        "sigma": dict(zip(camera.parameter_names, sigma.tolist(), strict=True)),
        "theta_deg": degrees.tolist(),
        **_pupil(file, theta),
        "r_px": (camera.fx * camera.radius(theta)).tolist(),
        "r_sigma_px": radius_sigma(camera, covariance, theta).tolist(),
        "projection_uncertainty": file.projection_uncertainty,
        "svp": {
            "distance": file.stand_in_distance,
            "loss_px": {str(key): value for key, value in file.stand_in_loss_px.items()},
        },
        "calibration": file.calibration,
        "board": None if file.board is None else {**file.board.to_dict(), "text": file.board.sentence},
    }


def _pupil(file: CameraFile, theta: np.ndarray) -> dict[str, Any]:
    """E and its band at theta (n,), rad: the camera's own or, where it has none, what its data leave open."""
    camera, left_open = file.camera, file.camera.pupil_left_open
    if left_open is not None and not camera.coefficients:
        value, sigma, source = left_open.entrance_pupil(theta), left_open.sigma(theta), "left open"
    else:
        value, sigma, source = camera.entrance_pupil(theta), pupil_sigma(camera, file.covariance, theta), "chosen"
    return {"E_m": value.tolist(), "E_sigma_m": sigma.tolist(), "E_from": source}
