"""A camera measured on other observations: every pose refitted, the camera frozen."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from fisheye_ep_calib.calibration.adjustment import AdjustmentProblem, AdjustmentState, adjust, residuals
from fisheye_ep_calib.calibration.board_warp import WARP_NAMES
from fisheye_ep_calib.calibration.fit import MIN_POINTS, Sightings, of_images, sightings_of
from fisheye_ep_calib.calibration.observations import Observations
from fisheye_ep_calib.calibration.ray_pose import poses_from_rays
from fisheye_ep_calib.camera import FisheyeCamera
from fisheye_ep_calib.errors import CalibrationError, InputError

_LOST = 0.05  # of the image's width: a view whose median error stays above has no pose


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
) -> Evaluation:
    """Refit every view's pose and measure what is left. board_warp (3,): metres, the target's known bow.

    theta_max is not enforced: sightings beyond the calibration's evidence are measured as well.
    """
    if camera.image_size != observations.image_size:
        raise InputError(
            f"the camera has {camera.image_size[0]}×{camera.image_size[1]} pixels, the observations "
            f"{observations.image_size[0]}×{observations.image_size[1]}"
        )
    camera = replace(camera, theta_max=np.pi)
    warp = np.zeros(len(WARP_NAMES)) if board_warp is None else np.asarray(board_warp, dtype=float)
    sightings = sightings_of(observations, disc_centers)
    failed = {
        int(image): f"fewer than {MIN_POINTS} points"
        for image in np.setdiff1d(np.unique(observations.image_index), sightings.images)
    }
    if len(sightings.images) == 0:
        raise CalibrationError(f"no view has {MIN_POINTS} points or more: there is nothing to evaluate")
    poses = _first_poses(camera, sightings)
    problem = AdjustmentProblem(
        sightings.blocks,
        sightings.features,
        np.zeros(len(camera.parameters), dtype=bool),
        theta_limit=camera.theta_limit,
    )
    state = AdjustmentState(camera, poses, warp)
    lost = _lost_views(problem, state, sightings)
    kept = sightings.images[~lost]
    failed |= {int(image): "no pose explains its points" for image in sightings.images[lost]}
    if len(kept) == 0:
        raise CalibrationError("no view fits the camera: is this the right camera file and target?")
    sightings = of_images(sightings, kept)
    problem = replace(problem, blocks=sightings.blocks)
    state = adjust(problem, AdjustmentState(camera, poses[~lost], warp)).state
    error, theta, _ = residuals(problem, state, len(observations.pixels))
    used = np.isfinite(error[:, 0]) & (observations.weights > 0)
    length = np.hypot(error[used, 0], error[used, 1]) * observations.weights[used]
    return Evaluation(
        error,
        theta,
        kept,
        state.camera_from_target,
        failed,
        float(np.sqrt((length**2).mean())),
        float(np.median(length)),
        float(np.quantile(length, 0.95)),
        int(used.sum()),
    )


def _first_poses(camera: FisheyeCamera, sightings: Sightings) -> np.ndarray:
    """Poses (V, 4, 4) from the camera's rays taken as if they met in one point; robust to wrong sightings."""
    poses = np.tile(np.eye(4), (len(sightings.images), 1, 1))
    for block in sightings.blocks:
        _, directions, valid = camera.unproject(np.moveaxis(block.pixels, 0, -1))
        used = (block.weights > 0) & valid
        poses[block.views] = poses_from_rays(
            np.moveaxis(directions, -1, 0), block.object_points, used, sightings.features.board, robust=True
        )
    return poses


def _lost_views(problem: AdjustmentProblem, state: AdjustmentState, sightings: Sightings) -> np.ndarray:
    """bool (V,): views that the first pose does not explain at all."""
    observations = sightings.observations
    error, _, valid = residuals(problem, state, len(observations.pixels))
    length = np.where(valid, np.hypot(error[:, 0], error[:, 1]), np.inf)
    limit = _LOST * max(observations.image_size)
    used = observations.weights > 0
    return np.array(
        [
            not np.isfinite(length[rows]).all() or np.median(length[rows]) > limit
            for rows in ((observations.image_index == image) & used for image in sightings.images)
        ]
    )
