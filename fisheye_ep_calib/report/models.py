"""Curves of the models that were compared, and of what the nearer and the farther views say by themselves."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from fisheye_ep_calib.calibration import CalibrationResult
from fisheye_ep_calib.calibration.camera_difference import CameraDifference, camera_difference
from fisheye_ep_calib.calibration.fit import MIN_VIEWS, Fit, of_images, refine
from fisheye_ep_calib.calibration.result import Comparison
from fisheye_ep_calib.calibration.structure import Structure
from fisheye_ep_calib.calibration.uncertainty import pupil_sigma, radius_sigma, uncertainty
from fisheye_ep_calib.camera import FisheyeCamera
from fisheye_ep_calib.errors import CalibrationError
from fisheye_ep_calib.report.data import LensCurve, ModelCurve, NearFar, Parameter, Residuals

_SAMPLES = 91
_RING_DEGREES = 10
_TARGET_AXIS = "_target_axis"


def angles(camera: FisheyeCamera) -> np.ndarray:
    """Angles (n,), rad, at which curves are drawn: 0 to the end of what is known."""
    return np.linspace(0.0, camera.theta_limit, _SAMPLES)


def pupil_curve(name: str, camera: FisheyeCamera, covariance: np.ndarray, theta, chosen: bool, **fit) -> ModelCurve:
    """fit: the fields parameters, rms_px and cross_validated_rms_px where they are known."""
    sigma = pupil_sigma(camera, covariance, theta) if camera.coefficients else np.zeros_like(theta)
    return ModelCurve(name, theta, camera.entrance_pupil(theta), sigma, chosen, **fit)


def lens_curve(camera: FisheyeCamera, covariance: np.ndarray) -> LensCurve:
    theta = angles(camera)
    return LensCurve(theta, camera.fx * camera.radius(theta), radius_sigma(camera, covariance, theta), camera.fx)


def parameters_of(camera: FisheyeCamera, covariance: np.ndarray) -> tuple[Parameter, ...]:
    """Every parameter with its σ; the pupil's in millimetres."""
    pupil = camera.parameter_slice("coefficients")
    rows = []
    for index, (name, value) in enumerate(zip(camera.parameter_names, camera.parameters, strict=True)):
        of_pupil = index in range(len(camera.parameters))[pupil]
        scale, unit = (1e3, "mm") if of_pupil else (1.0, "px" if name in ("fx", "fy", "skew", "cx", "cy") else "")
        sigma = float(np.sqrt(max(covariance[index, index], 0.0)))
        rows.append(Parameter(name, scale * float(value), scale * sigma if sigma > 0 else float("nan"), unit))
    return tuple(rows)


def compared_models(result: CalibrationResult) -> tuple[ModelCurve, ...]:
    """E(θ) of every model compared, each fitted to the sightings that the chosen one used."""
    theta = angles(result.camera)
    curves = []
    for name, one in result.comparison.items():
        fit = result.fit if name == result.model else _fit_of(result.fit, one)
        if fit is None:
            continue
        curves.append(
            pupil_curve(
                name,
                fit.state.camera,
                uncertainty(fit).covariance,
                theta,
                name == result.model,
                parameters=one.parameters,
                rms_px=one.rms_px,
                cross_validated_rms_px=one.cross_validated_rms_px,
            )
        )
    return tuple(curves)


def _fit_of(chosen: Fit, one: Comparison) -> Fit | None:
    """The compared model's fit again: the same structure but for its pupil."""
    central = replace(chosen.structure, model="kannala", terms=None, target_axis=False)
    terms = one.parameters - central.parameter_count
    structure: Structure = replace(
        chosen.structure,
        model=one.model.removesuffix(_TARGET_AXIS),
        terms=terms or None,
        target_axis=one.model.endswith(_TARGET_AXIS),
    )
    try:
        return refine(chosen, structure)
    except CalibrationError:
        return None


def near_far(result: CalibrationResult, residuals: Residuals) -> NearFar | None:
    """The structure fitted to the nearer and to the farther half of the views; None where a half is too small."""
    fit = result.fit
    views = len(fit.sightings.images)
    count = np.maximum(np.bincount(residuals.view, minlength=views), 1)
    mean = np.bincount(residuals.view, weights=residuals.distance, minlength=views) / count
    order = np.argsort(mean, kind="stable")
    halves, cameras, known = (order[: views // 2], order[views // 2 :]), [], []
    for part in halves:
        if len(part) < MIN_VIEWS:
            return None
        try:
            half = refine(fit, fit.structure, of_images(fit.sightings, fit.sightings.images[np.sort(part)]))
        except CalibrationError:
            return None
        if not half.adjustment.converged:
            return None
        seen = float(residuals.theta[np.isin(residuals.view, part)].max())
        cameras.append(replace(half.state.camera, theta_max=seen))
        known.append(uncertainty(half).covariance)
    found = camera_difference(*cameras, (np.inf,), (known[0], known[1]))
    theta, difference, expected = by_ring(found)
    near, far = (float(np.median(mean[part])) for part in halves)
    return NearFar(near, far, theta, difference[0], expected[0])


def by_ring(found: CameraDifference) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Middles of rings (r,), degrees, and RMS over each of the difference and of its expectation (d, r), px."""
    ring = (np.degrees(found.theta) // _RING_DEGREES).astype(int)
    rings = np.unique(ring)
    columns = [ring == one for one in rings]
    difference = np.stack([rms(found.length_px[:, column]) for column in columns], axis=-1)
    expected = np.stack([rms(found.sigma_px[:, column]) for column in columns], axis=-1)
    return _RING_DEGREES * (rings + 0.5), difference, expected


def rms(values: np.ndarray) -> np.ndarray:
    """Over the last axis, NaN left out; NaN where nothing is left."""
    finite = np.isfinite(values)
    square = np.where(finite, values, 0.0) ** 2
    count = finite.sum(axis=-1)
    return np.where(count > 0, np.sqrt(square.sum(axis=-1) / np.maximum(count, 1)), np.nan)
