"""Curves of the models that were compared, and of what the nearer and the farther views say by themselves."""

from __future__ import annotations

from typing import Any

import numpy as np

from fisheye_ep_calib.calibration import CalibrationResult
from fisheye_ep_calib.calibration.assessing.near_far import NearFarSplit
from fisheye_ep_calib.calibration.comparison import by_ring
from fisheye_ep_calib.camera import FisheyeCamera
from fisheye_ep_calib.camera.bands import pupil_sigma, radius_sigma
from fisheye_ep_calib.report.data import LensCurve, ModelCurve, NearFar, Parameter

_SAMPLES = 91


def angles(camera: FisheyeCamera) -> np.ndarray:
    """Angles (n,), rad, at which curves are drawn: 0 to the end of what is known."""
    return np.linspace(0.0, camera.theta_limit, _SAMPLES)


def pupil_curve(
    name: str, camera: FisheyeCamera, covariance: np.ndarray, theta: np.ndarray, chosen: bool, **fit: Any
) -> ModelCurve:
    """fit: the fields parameters, rms_px and cross_validated_rms_px where they are known."""
    sigma = pupil_sigma(camera, covariance, theta) if camera.coefficients else np.zeros_like(theta)
    return ModelCurve(name, theta, camera.entrance_pupil(theta), sigma, chosen, **fit)


def lens_curve(camera: FisheyeCamera, covariance: np.ndarray) -> LensCurve:
    theta = angles(camera)
    return LensCurve(theta, camera.fx * camera.radius(theta), radius_sigma(camera, covariance, theta), camera.fx)


def parameters_of(camera: FisheyeCamera, covariance: np.ndarray) -> tuple[Parameter, ...]:
    """Every parameter with its σ; the pupil's in millimetres."""
    rows = []
    named = zip(camera.layout.names, camera.layout.units, camera.parameters, strict=True)
    for index, (name, unit, value) in enumerate(named):
        scale, unit = (1e3, "mm") if unit == "m" else (1.0, unit)
        sigma = float(np.sqrt(max(covariance[index, index], 0.0)))
        rows.append(Parameter(name, scale * float(value), scale * sigma if sigma > 0 else float("nan"), unit))
    return tuple(rows)


def compared_models(result: CalibrationResult) -> tuple[ModelCurve, ...]:
    """E(θ) of every model compared, each fitted to the sightings that the chosen one used."""
    theta = angles(result.camera)
    return tuple(
        pupil_curve(
            name,
            entry.camera,
            entry.covariance,
            theta,
            name == result.model,
            parameters=entry.parameters,
            rms_px=entry.rms_px,
            cross_validated_rms_px=entry.cross_validated_rms_px,
        )
        for name, entry in result.comparison.items()
    )


def near_far_curve(split: NearFarSplit) -> NearFar:
    """The two halves' difference by angle."""
    theta, difference, expected = by_ring(split.difference)
    return NearFar(split.near_m, split.far_m, theta, difference[0], expected[0])
