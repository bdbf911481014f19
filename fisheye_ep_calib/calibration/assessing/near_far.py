"""The nearer and the farther half of the views by themselves: an error that hides at the distances recorded."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from fisheye_ep_calib.calibration.assessing.camera_difference import CameraDifference, camera_difference
from fisheye_ep_calib.calibration.assessing.finding import Finding
from fisheye_ep_calib.calibration.assessing.uncertainty import uncertainty
from fisheye_ep_calib.calibration.estimating.fit import Fit, refine
from fisheye_ep_calib.calibration.estimating.sightings import MIN_VIEWS, of_images
from fisheye_ep_calib.target.shape.model import FLAT

_TELLING = 1.0  # px expected between near and far, below which their agreement says something


@dataclass(frozen=True)
class NearFarSplit:
    """The structure fitted to the nearer and to the farther half of the views, and how the two cameras differ.

    near_m, far_m: median distances of the halves. difference: at infinity, for the field that both have seen.
    """

    near_m: float
    far_m: float
    difference: CameraDifference


def split_near_far(fit: Fit, distance: np.ndarray) -> NearFarSplit | None:
    """Fit the nearer and the farther half of the views by themselves and compare them at infinity.

    distance (n,): metres, of every sighting used. None where a half determines no camera, or both share no field.
    """
    observations, used = fit.sightings.observations, fit.used
    view = np.searchsorted(fit.sightings.images, observations.image_index[used])
    views = len(fit.sightings.images)
    mean = np.bincount(view, weights=distance, minlength=views) / np.maximum(np.bincount(view, minlength=views), 1)
    order = np.argsort(mean, kind="stable")
    parts = (order[: views // 2], order[views // 2 :])
    cameras, covariances = [], []
    for part in parts:
        images = fit.sightings.images[np.sort(part)]
        enough = 2 * sum(np.isin(observations.image_index[used], images)) > 2 * fit.problem.shared_size + 12 * len(part)
        if len(part) < MIN_VIEWS or not enough:
            return None
        half = refine(fit, fit.structure, of_images(fit.sightings, images))
        if not half.adjustment.converged:
            return None
        largest_angle = half.largest_angle
        try:
            half_uncertainty = uncertainty(half)
        except np.linalg.LinAlgError:  # half of the views leave something open
            return None
        # A model that fails makes residuals correlate within a view: that must not excuse it.
        covariances.append(half_uncertainty.covariance / half_uncertainty.clustering)
        cameras.append(replace(half.state.camera, theta_max=largest_angle))
    near, far = (float(np.median(mean[part])) for part in parts)
    difference = camera_difference(cameras[0], cameras[1], (np.inf,), (covariances[0], covariances[1]))
    if not np.isfinite(difference.length_px).any():
        return None
    return NearFarSplit(near, far, difference)


def near_far_advice(fit: Fit, chosen: bool) -> str:
    """What may help where near and far differ and was not tried already."""
    if not (fit.structure.pupil_terms or chosen):
        return "let a pupil be estimated (model auto), or record only at the distance of use"
    if fit.structure.board_shape == FLAT:
        return "check that the target is flat and record more views, near and far"
    return "record more views, near and far, or only at the distance of use"


def near_far(split: NearFarSplit, advice: str) -> Finding:
    difference, expected = (
        float(np.sqrt(np.nanmean(px**2))) for px in (split.difference.length_px, split.difference.sigma_px)
    )
    values = {
        "near_m": split.near_m,
        "far_m": split.far_m,
        "difference_px": difference,
        "expected_px": expected,
    }
    told = (
        f"the near half ({split.near_m:.3f} m) and the far half ({split.far_m:.3f} m) differ by "
        f"{difference:.3f} px at infinity, {expected:.3f} px expected"
    )
    if difference <= 2.5 * expected:
        if expected < _TELLING:
            return Finding("near_far", values, False, f"{told}: the camera holds at every distance recorded")
        told += ": these data cannot tell whether it holds at other distances; record more views, near and far"
        return Finding("near_far", values, True, told)
    return Finding(
        "near_far",
        values,
        True,
        f"{told}: an error hides at the distances recorded and shows at others; {advice}",
    )
