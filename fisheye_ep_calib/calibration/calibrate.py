"""Calibrate one camera from its observations."""

from __future__ import annotations

import time
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from fisheye_ep_calib.calibration.assessing.refusal import focal_length_determined, why_undetermined, why_unusable
from fisheye_ep_calib.calibration.estimating.fit import Fit, independent_covariance
from fisheye_ep_calib.calibration.observations import Observations
from fisheye_ep_calib.calibration.options import AUTO, Options, base_structure, wanted_shape, with_board
from fisheye_ep_calib.calibration.result import CalibrationResult
from fisheye_ep_calib.calibration.screened_fit import screened_fit
from fisheye_ep_calib.calibration.selecting.model_selection import Search, choose
from fisheye_ep_calib.camera import FisheyeCamera
from fisheye_ep_calib.camera.extras.lens_field import LENS_FIELD
from fisheye_ep_calib.errors import CalibrationError

_JUDGES = ("ep_even", "ep_odd")  # between them they come near to every pupil
_NO_CAMERA = 0.02  # median error over the longer side of the image


def calibrate(observations: Observations, model: str = AUTO, **options: Any) -> CalibrationResult:
    """Calibrate a camera. options: those of ``Options.of``. Raises CalibrationError, InputError.

    A named model is fitted as it is, skew included and the board flat, and nothing else: what judges it is worked out
    when it is looked at (result.py). "auto" fits all models, decides skew, tangential terms and board warp, and takes
    what the data support.
    """
    settings = Options.of(**options)
    observations = with_board(observations, settings)
    base = base_structure(settings, model)
    families = _JUDGES if model == AUTO else (base.model,)
    screened = screened_fit(observations, settings, base, wanted_shape(settings, model), families)
    began = time.perf_counter()
    choice, fit = None, screened.fit
    if model == AUTO:
        choice = choose(screened.start, screened.fit, _open_questions(settings))
        choice = replace(choice, reasons=(*screened.reasons, *choice.reasons))
        fit = choice.chosen.fit
    seconds = screened.seconds | {"compare": time.perf_counter() - began}
    _refuse_unexplained(fit)
    result = CalibrationResult(
        fit, screened.rejected, screened.wrong_views, seconds, choice, settings.svp_distance, screened.same_place
    )
    refused = _why_refused(result)
    if refused is not None:
        if not settings.force:
            raise CalibrationError(f"{refused}, or take it as it is with `force`")
        result = replace(result, refused=refused)
    if np.isfinite(settings.svp_distance):
        _ = result.stand_in  # refuses a distance that is too near
    return result


@dataclass(frozen=True)
class RoughCamera:
    """Good enough to say where in an image the target is. camera: valid to the largest angle seen.

    camera_from_target (V, 4, 4): metres, poses in the images of these numbers, view_images (V,), sorted; images of a
    board at rest share one. seconds: as in ``CalibrationResult``, without "compare".
    """

    camera: FisheyeCamera
    camera_from_target: np.ndarray
    view_images: np.ndarray
    seconds: dict[str, float]


def rough_camera(observations: Observations, model: str = AUTO, **options: Any) -> RoughCamera:
    """What a second look at the images needs of a first calibration: camera and poses, and nothing chosen or judged.

    Takes the arguments of ``calibrate``. The camera is the named model, or for "auto" one with an even pupil; wrong
    sightings are left out. Raises CalibrationError, InputError.
    """
    settings = Options.of(**options)
    observations = with_board(observations, settings)
    screened = screened_fit(observations, settings, base_structure(settings, model))
    fit = screened.fit
    _refuse_unexplained(fit)
    camera = replace(fit.state.camera, theta_max=fit.largest_angle)
    poses = dict(zip(fit.sightings.images.tolist(), fit.state.camera_from_target, strict=True))
    for first, images in screened.same_place.items():
        poses |= {image: poses[first] for image in images if first in poses}
    numbers = sorted(poses)
    return RoughCamera(camera, np.array([poses[image] for image in numbers]), np.array(numbers), screened.seconds)


def _open_questions(settings: Options) -> Search:
    return Search(
        skew=settings.skew is None,
        lens=settings.lens is None,
        extras=(
            *(name for name in ("tangential", "tilt") if settings.extras.get(name) is None),
            *((LENS_FIELD.name,) if settings.extras.get(LENS_FIELD.name) else ()),
        ),
    )


def _refuse_unexplained(fit: Fit) -> None:
    """Refuse a camera that explains nothing."""
    if fit.median_px > _NO_CAMERA * max(fit.sightings.observations.image_size):
        raise CalibrationError(
            f"no camera explains the points (half of them are off by {fit.median_px:.0f} px or more): "
            "check that the target file describes the board in the images"
        )


def _why_refused(result: CalibrationResult) -> str | None:
    """Why the views leave the focal length open, by the bands as they are given; None where they do not."""
    if not focal_length_determined(result.fit):
        return why_undetermined(result.fit)
    if result.choice:
        return why_unusable(result.fit, result.uncertainty.covariance)
    return why_unusable(result.fit, result.fit.clustering * independent_covariance(result.fit)[1])
