"""A camera file as plain data, for programs."""

from __future__ import annotations

from typing import Any

import numpy as np

from fisheye_ep_calib.camera.bands import entrance_pupil_band, radius_sigma
from fisheye_ep_calib.storage.camera_file_parsing import CameraFile


def camera_content(file: CameraFile) -> dict[str, Any]:
    """What there is to say of a camera file: ``show --json``. Curves are told at whole degrees up to theta_max."""
    camera, covariance = file.camera, file.covariance
    degrees = np.arange(int(np.floor(np.degrees(camera.theta_max) + 1e-9)) + 1)
    theta = np.radians(degrees)
    shift, shift_sigma, shift_from = entrance_pupil_band(camera, covariance, theta)
    sigma = np.sqrt(np.maximum(np.diag(covariance), 0))
    return {
        "name": file.name,
        "origin": file.origin,
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
        "E_m": shift.tolist(),
        "E_sigma_m": shift_sigma.tolist(),
        "E_from": shift_from,
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


def fact_in_words(value: Any) -> str:
    """What a file tells of its calibration, for a person."""
    if isinstance(value, dict):
        return ", ".join(f"{key} {number:.4g}" for key, number in value.items())
    return str(value)
