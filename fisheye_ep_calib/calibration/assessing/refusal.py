"""Whether a camera may be used at all, and what the views lack where it may not.

A camera whose focal length is known to a tenth projects points to wrong places by a tenth of their radius, however
small its residuals are. It is judged with the bands as they are given: clustering and spread over families included.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from fisheye_ep_calib.calibration.assessing.coverage import azimuth_and_distance
from fisheye_ep_calib.calibration.estimating.adjustment import adjust
from fisheye_ep_calib.calibration.estimating.fit import Fit, independent_covariance

_LOOSE = 0.2  # σ of a focal length over its value, at which it counts as unknown
_SURE = 0.05  # and below which the linear σ is to be believed
LARGEST_SIGMA = 0.05  # of a focal length over its value
_PARALLEL = np.radians(12)  # boards whose normals lie within it are as good as parallel
_ONE_DISTANCE = 1.4  # farthest over nearest view
_CENTRE = 0.4  # of the half diagonal


def why_unusable(fit: Fit, covariance: np.ndarray) -> str | None:
    """One line that says why a camera must not be used, what its views lack, and what to do; None where it may be.

    covariance: of parameters that begin with fx and fy.
    """
    _, values = fit.shared_parameters
    sigma = np.sqrt(np.maximum(np.diag(covariance)[:2], 0)) / values[:2]
    if (sigma <= LARGEST_SIGMA).all():
        return None
    return _told(fit, f"its standard deviation is {100 * sigma.max():.0f} % of its value")


def why_undetermined(fit: Fit) -> str:
    """The same where they leave it open altogether."""
    return _told(fit, "its standard deviation is over a fifth of its value")


def _told(fit: Fit, how_well: str) -> str:
    lacks, advice = _lacks(fit)
    why = f": {', '.join(lacks)}" if lacks else ""
    demand = f"{how_well}, {100 * LARGEST_SIGMA:.0f} % at most"
    return f"the views do not determine the focal length ({demand}){why}; {', '.join(advice)}"


def _lacks(fit: Fit) -> tuple[list[str], list[str]]:
    """What the views have too little of, measured, and what to record in its place."""
    lacks, advice = [], []
    tilt, spread = _tilts(fit)
    if spread < _PARALLEL:
        to_sensor = tilt.max() < 1.5 * _PARALLEL
        lacks.append(
            f"the boards are all parallel {'to the sensor ' if to_sensor else ''}within {np.degrees(spread):.0f}°"
        )
        advice.append("tilt the target by 30° and more, differently between the views")
    _, distance = azimuth_and_distance(
        fit.sightings.observations, fit.sightings.images, fit.state.camera_from_target, fit.used
    )
    near, far = np.quantile(distance, [0.05, 0.95])
    if far < _ONE_DISTANCE * near:
        lacks.append(f"all points are at one distance ({near:.2g}–{far:.2g} m)")
        advice.append("show the target near and far")
    share = _reach(fit)
    if share < _CENTRE:
        lacks.append(f"points keep to the inner {100 * share:.0f} % of the image")
        advice.append("move the target out to the edge of the image")
    return lacks, advice or ["tilt the target differently between the views and show it near, far and at the edge"]


def _tilts(fit: Fit) -> tuple[np.ndarray, float]:
    """Angles (V,) of the boards' normals to the axis, and that within which most normals are of their mean, rad."""
    normals = fit.state.camera_from_target[:, :3, :3] @ fit.problem.features.board.axes[:, 2]
    normals = normals * np.where(normals[:, 2:] < 0, -1, 1)
    mean = normals.mean(axis=0)
    mean /= np.linalg.norm(mean)
    spread = float(np.quantile(np.arccos(np.clip(normals @ mean, -1, 1)), 0.8))
    return np.arccos(np.clip(normals[:, 2], -1, 1)), spread


def _reach(fit: Fit) -> float:
    """How far out nearly all points lie, over the half diagonal of the image."""
    size = np.array(fit.sightings.observations.image_size)
    offset = fit.sightings.observations.pixels[fit.used] - (size - 1) / 2
    return float(np.quantile(np.hypot(*offset.T), 0.95) / (0.5 * np.hypot(*size)))


def focal_length_determined(fit: Fit) -> bool:
    """Whether it is known to a fifth, also by the likelihood itself where the linear σ is not small.

    Where views leave it open, the valley of equal cost bends: σ may look small where the fit happened to stop.
    """
    _, values = fit.shared_parameters
    try:
        sigma_px, covariance = independent_covariance(fit)
    except np.linalg.LinAlgError:
        return False
    # Not more than independent noise leaves open: a model that does not fit is another matter.
    variance = np.diag(covariance)[:2]
    if not ((variance >= 0) & (variance <= (_LOOSE * values[:2]) ** 2)).all():
        return False
    if (variance <= (_SURE * values[:2]) ** 2).all():
        return True
    least = fit.adjustment.equations.cost + 0.5 * sigma_px**2
    return all(_cost_at(fit, scale) > least for scale in (1 + _LOOSE, 1 / (1 + _LOOSE)))


def _cost_at(fit: Fit, scale: float) -> float:
    """The least cost, px², with both focal lengths held at so many times their values; ∞ for no such camera."""
    camera = fit.state.camera
    held = replace(fit.problem, free=fit.problem.free & ~np.isin(camera.parameter_names, ("fx", "fy")))
    moved = replace(camera, fx=scale * camera.fx, fy=scale * camera.fy)
    equations = adjust(replace(held, theta_limit=np.pi), replace(fit.state, camera=moved)).equations
    return equations.cost if equations.valid else np.inf
