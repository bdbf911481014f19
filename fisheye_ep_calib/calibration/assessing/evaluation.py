"""A camera measured on other observations: every pose refitted, the camera frozen."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from fisheye_ep_calib.calibration.estimating.adjustment import AdjustmentProblem, AdjustmentState, adjust, residuals
from fisheye_ep_calib.calibration.estimating.fit import Fit
from fisheye_ep_calib.calibration.estimating.point_names import recounted
from fisheye_ep_calib.calibration.estimating.pose_repair import ray_poses
from fisheye_ep_calib.calibration.estimating.sightings import (
    MIN_POINTS,
    Sightings,
    of_images,
    sightings_of,
    why_no_pose,
)
from fisheye_ep_calib.calibration.estimating.views import view_blocks
from fisheye_ep_calib.calibration.observations import Observations
from fisheye_ep_calib.calibration.structure import Structure
from fisheye_ep_calib.camera import FisheyeCamera
from fisheye_ep_calib.errors import CalibrationError, InputError
from fisheye_ep_calib.target.shape.bow import WARP_NAMES
from fisheye_ep_calib.target.shape.measured import BoardShape
from fisheye_ep_calib.target.shape.model import BOW, ShapeState, bow_model

_FAR_OFF = 0.01  # of the image's longer side: a first pose with a larger median error is refitted before it is judged
_LOST = 0.05  # of the image's longer side: a view whose median error stays above has no pose


@dataclass(frozen=True)
class Evaluation:
    """error (M, 2): predicted minus measured pixels by observation row, NaN where not used. theta (M,): rad.

    images (V,): image numbers of camera_from_target (V, 4, 4). failed: image number → why no pose was found.
    """

    error: np.ndarray
    theta: np.ndarray
    images: np.ndarray
    camera_from_target: np.ndarray
    failed: dict[int, str]
    rms_px: float
    median_px: float
    p95_px: float
    points: int


def evaluate_camera(
    camera: FisheyeCamera,
    observations: Observations,
    board_warp: np.ndarray | None = None,
    disc_centers: str = "unbiased",
    board: BoardShape | None = None,
) -> Evaluation:
    """Refit every view's pose and measure what is left. board: the target's known shape; board_warp (3,): metres, its
    bow.

    theta_max is not enforced: sightings beyond the calibration's evidence are measured as well.
    """
    return measured(*posed_views(camera, observations, board_warp, disc_centers, board))


def posed_views(
    camera: FisheyeCamera,
    observations: Observations,
    board_warp: np.ndarray | None = None,
    disc_centers: str = "unbiased",
    board: BoardShape | None = None,
) -> tuple[Fit, dict[int, str]]:
    """Poses of a target of known shape beside a camera that is held; image number → why it has none.

    The points of a plain lattice are named by its shape (point_names.py). Takes the arguments of ``evaluate_camera``.
    """
    if camera.image_size != observations.image_size:
        raise InputError(
            f"the camera has {camera.image_size[0]}×{camera.image_size[1]} pixels, the observations "
            f"{observations.image_size[0]}×{observations.image_size[1]}"
        )
    camera = replace(camera, theta_max=np.pi)
    given = observations if board is None else replace(observations, board=board)
    sightings = sightings_of(given, disc_centers)
    failed = {
        int(image): why_no_pose(observations, int(image))
        for image in np.setdiff1d(np.unique(observations.image_index), sightings.images)
    }
    if len(sightings.images) == 0:
        raise CalibrationError(f"no view has {MIN_POINTS} points not on one line: there is nothing to evaluate")
    problem = AdjustmentProblem(
        sightings.blocks,
        sightings.features,
        np.zeros(len(camera.parameters), dtype=bool),
        bow_model(sightings.target),
        shape_free=False,
        theta_limit=camera.theta_limit,
    )
    bow = np.zeros(len(WARP_NAMES)) if board_warp is None else np.asarray(board_warp, dtype=float)
    state = AdjustmentState(camera, ray_poses(camera, sightings), ShapeState(bow))
    state = _close_ups_refitted(problem, state, sightings)
    lost = _views_where(_median_error(problem, state, sightings) > _LOST * max(observations.image_size), sightings)
    failed |= dict.fromkeys(lost, "no pose explains its points")
    problem, state, sightings = _without(lost, problem, state, sightings)
    state = _refitted_to_visible(problem, state, sightings)
    outside = _views_where(_invalid_count(problem, state, sightings) > 0, sightings)
    failed |= dict.fromkeys(outside, "the camera cannot project all of its points")
    problem, state, sightings = _without(outside, problem, state, sightings)
    fit = Fit(Structure.of_camera(camera, BOW), sightings, problem, adjust(problem, state))
    if observations.mistakable:
        alike, others = recounted(fit)
        if others:
            fit = replace(alike, adjustment=adjust(alike.problem, alike.state))
    return fit, failed


def measured(fit: Fit, failed: dict[int, str]) -> Evaluation:
    """What is left of the residuals beside a camera that is held."""
    error, theta, _ = fit.residuals
    weights = fit.sightings.observations.weights
    used = np.isfinite(error[:, 0]) & (weights > 0)
    length = np.hypot(error[used, 0], error[used, 1]) * weights[used]
    return Evaluation(
        error,
        theta,
        fit.sightings.images,
        fit.state.camera_from_target,
        failed,
        float(np.sqrt((length**2).mean())),
        float(np.median(length)),
        float(np.quantile(length, 0.95)),
        int(used.sum()),
    )


def where_to_look_again(
    camera: FisheyeCamera, observations: Observations
) -> tuple[FisheyeCamera, dict[int, np.ndarray]]:
    """A camera and poses (4, 4) by image number, by which to find in images what the observations have missed.

    The camera is believed as far out as the observations reach: one from few views has evidence of the middle of the
    image alone, and would lose what was found beyond it. Raises CalibrationError where no view fits the camera.
    """
    evaluation = evaluate_camera(camera, observations)
    reach = max(camera.theta_max, float(np.nanmax(evaluation.theta)))
    poses = dict(zip(evaluation.images.tolist(), evaluation.camera_from_target, strict=True))
    return replace(camera, theta_max=reach), poses


def _close_ups_refitted(problem: AdjustmentProblem, state: AdjustmentState, sightings: Sightings) -> AdjustmentState:
    """Poses in which views far off their points are refitted: rays do not meet in one point, least of all close up."""
    off = np.flatnonzero(_median_error(problem, state, sightings) > _FAR_OFF * max(sightings.observations.image_size))
    if len(off) == 0:
        return state
    part = of_images(sightings, sightings.images[off])
    start = replace(state, camera_from_target=state.camera_from_target[off])
    _, _, valid = residuals(problem, state, len(sightings.observations.pixels))
    visible = replace(sightings.observations, weights=np.where(valid, sightings.observations.weights, 0.0))
    refitted = adjust(replace(problem, blocks=view_blocks(visible, part.images)), start).state.camera_from_target
    poses = state.camera_from_target.copy()
    poses[off] = refitted
    return replace(state, camera_from_target=poses)


def _views_where(marked: np.ndarray, sightings: Sightings) -> list[int]:
    return [int(image) for image in sightings.images[marked]]


def _without(
    images: list[int], problem: AdjustmentProblem, state: AdjustmentState, sightings: Sightings
) -> tuple[AdjustmentProblem, AdjustmentState, Sightings]:
    """Problem, state and sightings without these images; refuses to leave none."""
    kept = ~np.isin(sightings.images, images)
    if not kept.any():
        raise CalibrationError("no view fits the camera: is this the right camera file and target?")
    sightings = of_images(sightings, sightings.images[kept])
    state = replace(state, camera_from_target=state.camera_from_target[kept])
    return replace(problem, blocks=sightings.blocks), state, sightings


def _by_view(problem: AdjustmentProblem, state: AdjustmentState, sightings: Sightings) -> list[np.ndarray]:
    """Error lengths, px, of each view's sightings in use; infinite where the camera has no projection."""
    observations = sightings.observations
    error, _, valid = residuals(problem, state, len(observations.pixels))
    length = np.where(valid, np.hypot(error[:, 0], error[:, 1]), np.inf)
    used = observations.weights > 0
    return [length[rows][used[rows]] for rows in observations.rows_of(sightings.images)]


def _median_error(problem: AdjustmentProblem, state: AdjustmentState, sightings: Sightings) -> np.ndarray:
    """(V,) px."""
    return np.array([np.median(lengths) for lengths in _by_view(problem, state, sightings)])


def _invalid_count(problem: AdjustmentProblem, state: AdjustmentState, sightings: Sightings) -> np.ndarray:
    """(V,): sightings without a projection."""
    return np.array([np.isinf(lengths).sum() for lengths in _by_view(problem, state, sightings)])


def _refitted_to_visible(problem: AdjustmentProblem, state: AdjustmentState, sightings: Sightings) -> AdjustmentState:
    """Poses refitted to what the first ones can project: in a close-up those of rays through one point are far off."""
    observations = sightings.observations
    _, _, valid = residuals(problem, state, len(observations.pixels))
    if valid[(observations.weights > 0) & np.isin(observations.image_index, sightings.images)].all():
        return state
    visible = replace(observations, weights=np.where(valid, observations.weights, 0.0))
    return adjust(replace(problem, blocks=view_blocks(visible, sightings.images)), state).state
