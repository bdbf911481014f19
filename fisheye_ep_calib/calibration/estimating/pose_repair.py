"""Views whose pose is wrong though the fit has settled: a board that started mirrored or turned over stays so.

The first poses come from a crude camera. The rays of the camera as fitted give others, and so does a flat board's
mirror image; a view takes one of them where that explains its sightings better.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from fisheye_ep_calib.arrays import FloatArray
from fisheye_ep_calib.calibration.estimating.adjustment import adjust, residuals
from fisheye_ep_calib.calibration.estimating.fit import Fit, adjusted
from fisheye_ep_calib.calibration.estimating.ray_pose import poses_from_rays
from fisheye_ep_calib.calibration.estimating.sightings import Sightings, of_images
from fisheye_ep_calib.camera import FisheyeCamera
from fisheye_ep_calib.rotation import placed
from fisheye_ep_calib.target.shape.frame import BoardFrame

_SUSPICIOUS = 1.5  # times the median view's RMS
_POOR = 1.0  # px RMS, at which a view is looked at anyway
_BETTER = 0.9  # of a view's squared error
_ROUNDS = 3  # a wrong pose drags the camera, and hides others


def ray_poses(camera: FisheyeCamera, sightings: Sightings) -> np.ndarray:
    """Poses (V, 4, 4) from the camera's rays taken as if they met in one point; robust to wrong sightings."""
    poses = np.tile(np.eye(4), (len(sightings.images), 1, 1))
    for block in sightings.blocks:
        _, directions, valid = camera.unproject(np.moveaxis(block.pixels, 0, -1))
        used = (block.weights > 0) & valid
        poses[block.views] = poses_from_rays(
            np.moveaxis(directions, -1, 0), block.object_points, used, sightings.features.board, robust=True
        )
    return poses


def mirrored_poses(poses: np.ndarray, board: BoardFrame) -> np.ndarray:
    """Poses (V, 4, 4) of a flat board tilted the other way, which nearly looks the same where it is small or far.

    With d the direction to its middle, depths along d change sign, x ← (I − 2 d dᵀ) x, and the front stays the front
    (the ambiguity of Schweighofer and Pinz, Robust Pose Estimation from a Planar Target, 2006).
    """
    middle = placed(poses, board.middle)
    direction = middle / np.linalg.norm(middle, axis=-1, keepdims=True)
    mirror = np.eye(3) - 2 * direction[:, :, None] * direction[:, None]
    result: FloatArray = poses.copy()
    result[:, :3, :3] = mirror @ poses[:, :3, :3] @ (np.eye(3) - 2 * np.outer(board.axes[:, 2], board.axes[:, 2]))
    result[:, :3, 3] = middle - result[:, :3, :3] @ board.middle
    return result


def repaired(fit: Fit) -> Fit:
    """The fit from better poses where there are any, or else the fit itself."""
    for _ in range(_ROUNDS):
        poses = _better_poses(fit)
        if poses is None:
            return _started_again(fit) if fit.rms_px > _POOR * fit.sightings.usual_weight else fit
        fit = adjusted(fit.structure, fit.sightings, fit.problem, replace(fit.state, camera_from_target=poses))
    return fit


def _started_again(fit: Fit) -> Fit:
    """The fit from ray poses of all views, where that ends better: many wrong poses bend the camera to themselves."""
    camera = replace(fit.state.camera, theta_max=fit.problem.theta_limit)
    state = replace(fit.state, camera_from_target=ray_poses(camera, fit.sightings))
    again = adjusted(fit.structure, fit.sightings, fit.problem, state)
    equations = again.adjustment.equations
    return again if equations.valid and equations.cost < _BETTER * fit.adjustment.equations.cost else fit


def _better_poses(fit: Fit) -> np.ndarray | None:
    """Poses (V, 4, 4) with those replaced for which a better one is found; None where there is none."""
    square = fit.adjustment.equations.by_view[:, -1, -1]  # of each view, as the loss counts it
    rms = np.sqrt(square / np.maximum(fit.sightings.view_counts, 1))
    looked_at = np.flatnonzero((rms > _SUSPICIOUS * np.median(rms)) | (rms > _POOR * fit.sightings.usual_weight))
    if len(looked_at) == 0:
        return None
    part = of_images(fit.sightings, fit.sightings.images[looked_at])
    camera = replace(fit.state.camera, theta_max=fit.problem.theta_limit)
    problem = replace(fit.problem, blocks=part.blocks, free=np.zeros_like(fit.problem.free), shape_free=False)
    starts = [ray_poses(camera, part)]
    if fit.sightings.features.board.planar:
        starts.append(mirrored_poses(fit.state.camera_from_target[looked_at], fit.sightings.features.board))
    rows = np.isin(part.observations.image_index, part.images) & (part.observations.weights > 0)
    view = np.searchsorted(part.images, part.observations.image_index[rows])
    poses, least, any_better = fit.state.camera_from_target.copy(), _BETTER * square[looked_at], False
    for start in starts:
        refitted = adjust(problem, replace(fit.state, camera_from_target=start), max_iterations=30, tolerance=1e-4)
        _, _, valid = residuals(problem, refitted.state, len(part.observations.pixels))
        visible = np.bincount(view, ~valid[rows], minlength=len(part.images)) == 0
        explained = refitted.equations.by_view[:, -1, -1]
        better = visible & (explained < least)
        poses[looked_at[better]] = refitted.state.camera_from_target[better]
        least = np.where(better, explained, least)
        any_better |= bool(better.any())
    return poses if any_better else None
