"""Bundle adjustment of a rig: every camera's pose, one pose of the target a moment, and what else is free.

A point P of the target is seen by camera c at moment m through X_c B_m, with X_c = camera_from_reference (the identity
for camera 0) and B_m = reference_from_target. With X = (R, t), B = (Q, ·), s where B puts the board's middle, and a
projection's derivatives by the composed pose's steps, ω and δ of R Q ← exp(ω) R Q, R s + t ← R s + t + δ
(prediction.py):

    B: ∂ω = R, ∂δ = R            since R exp(ω) Q = exp(R ω) R Q
    X: ∂ω = (I, −[R s]×), ∂δ = I   since exp(ω) turns R s as well

The moments' poses are eliminated as the views' are in a single camera's adjustment (equations.py).
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, field, replace

import numpy as np

from fisheye_ep_calib.calibration.estimating.levenberg_marquardt import Minimum, minimise
from fisheye_ep_calib.calibration.estimating.normal_equations import Step
from fisheye_ep_calib.calibration.estimating.prediction import FeatureModel, Prediction, predict
from fisheye_ep_calib.calibration.estimating.robust import LINEAR, Loss
from fisheye_ep_calib.calibration.estimating.views import ViewBlock, view_blocks
from fisheye_ep_calib.calibration.observations import Observations
from fisheye_ep_calib.camera import FisheyeCamera
from fisheye_ep_calib.errors import InputError
from fisheye_ep_calib.rig.equations import RigEquations, RigProducts, solve_rig
from fisheye_ep_calib.rotation import moved_poses, placed, turn_jacobian
from fisheye_ep_calib.target.shape.bow import WARP_NAMES
from fisheye_ep_calib.target.shape.model import ShapeModel, ShapeState


@dataclass(frozen=True)
class CameraViews:
    """What one camera saw. moments (V,): the moment of each of the blocks' views. free (P,) bool: its parameters."""

    observations: Observations
    moments: np.ndarray
    blocks: tuple[ViewBlock, ...]
    free: np.ndarray


@dataclass(frozen=True)
class RigState:
    """cameras: C of them. camera_from_reference (C, 4, 4), reference_from_target (M, 4, 4), board_warp (3,): metres."""

    cameras: tuple[FisheyeCamera, ...]
    camera_from_reference: np.ndarray
    reference_from_target: np.ndarray
    board_warp: np.ndarray = field(default_factory=lambda: np.zeros(len(WARP_NAMES)))


@dataclass(frozen=True)
class RigProblem:
    """What is seen and what is free. The shared parameters are, in this order: the poses of the cameras 1, 2, …
    (ω, δ each), the free parameters of camera 0, 1, …, the board warp where it is free.
    """

    views: tuple[CameraViews, ...]
    features: FeatureModel
    shape: ShapeModel
    warp_free: bool = False
    loss: Loss = LINEAR

    @property
    def moment_count(self) -> int:
        return 1 + max(int(view.moments.max(initial=-1)) for view in self.views)

    @property
    def pose_size(self) -> int:
        return 6 * (len(self.views) - 1)

    @property
    def shared_size(self) -> int:
        free = sum(int(view.free.sum()) for view in self.views)
        return self.pose_size + free + len(WARP_NAMES) * self.warp_free

    def parameter_columns(self, camera: int) -> np.ndarray:
        """Where a camera's free parameters stand among the shared ones."""
        counts = [int(view.free.sum()) for view in self.views]
        start = self.pose_size + sum(counts[:camera])
        return np.arange(start, start + counts[camera])


def camera_views(observations: Observations, images: np.ndarray, moments: np.ndarray, free: np.ndarray) -> CameraViews:
    """images (V,): the image numbers to use, sorted; moments (V,): when each was taken."""
    return CameraViews(observations, moments, view_blocks(observations, images), free)


def adjust_rig(problem: RigProblem, state: RigState, max_iterations: int = 100) -> Minimum[RigState]:
    """Minimise the reprojection error from a state on."""
    return minimise(
        lambda trial: evaluate_rig(problem, trial),
        lambda current, step: _stepped(problem, current, step),
        state,
        max_iterations,
        solve=solve_rig,
    )


def evaluate_rig(problem: RigProblem, state: RigState) -> RigEquations:
    """The normal equations at a state; ``by_view`` counts moments."""
    columns = [_columns(problem, camera) for camera in range(len(problem.views))]
    sums = RigProducts([views.moments for views in problem.views], columns, problem.moment_count, problem.shared_size)
    cost, valid = 0.0, True
    for camera in range(len(problem.views)):
        for block, moments, predicted in _predictions(problem, state, camera, jacobian=True):
            used = block.weights > 0
            valid = valid and bool(predicted.valid[used].all())
            system = _system(problem, state, camera, block, moments, predicted)
            system = np.concatenate([system, (predicted.pixels - block.pixels)[:, None]], axis=1)
            weights = np.where(predicted.valid, block.weights, 0.0)
            square = (system[0, -1] ** 2 + system[1, -1] ** 2) * weights**2
            loss, factor = problem.loss.evaluate(square)
            cost += 0.5 * float(loss[used].sum())
            by_view = np.swapaxes(system * (weights * factor), 1, 2)
            products = by_view[0] @ np.swapaxes(by_view[0], 1, 2) + by_view[1] @ np.swapaxes(by_view[1], 1, 2)
            sums.add(camera, moments, products)
    return sums.equations(cost, valid and bool(np.isfinite(cost)))


def rig_residuals(problem: RigProblem, state: RigState) -> list[np.ndarray]:
    """For each camera predicted minus measured pixels (M_c, 2), by observation row; NaN in images that are not used."""
    results = []
    for camera, views in enumerate(problem.views):
        result = np.full((len(views.observations.pixels), 2), np.nan)
        for block, _, predicted in _predictions(problem, state, camera):
            error = np.where(predicted.valid, predicted.pixels - block.pixels, np.nan)
            result[block.rows[block.real]] = error[:, block.real].T
        results.append(result)
    return results


def _predictions(
    problem: RigProblem, state: RigState, camera: int, jacobian: bool = False
) -> Iterator[tuple[ViewBlock, np.ndarray, Prediction]]:
    """Each block of a camera with its views' moments and what is predicted for it."""
    views, model = problem.views[camera], state.cameras[camera]
    surface = problem.shape.surface(ShapeState(state.board_warp))
    model = replace(model, theta_max=np.pi)  # sightings beyond the calibration's evidence are still sightings
    for block in views.blocks:
        moments = views.moments[block.views]
        poses = state.camera_from_reference[camera] @ state.reference_from_target[moments]
        predicted = predict(
            model,
            problem.features,
            surface,
            poses,
            block,
            model.theta_limit,
            jacobian,
            jacobian and problem.warp_free,
        )
        yield block, moments, predicted


def _columns(problem: RigProblem, camera: int) -> np.ndarray:
    """Where the shared ones of ``_system``'s columns stand: the camera's pose, its parameters, warp."""
    parts = [problem.parameter_columns(camera)]
    if camera > 0:
        parts.insert(0, np.arange(6 * (camera - 1), 6 * camera))
    if problem.warp_free:
        parts.append(np.arange(problem.shared_size - len(WARP_NAMES), problem.shared_size))
    return np.concatenate(parts)


def _system(
    problem: RigProblem, state: RigState, camera: int, block: ViewBlock, moments: np.ndarray, predicted: Prediction
) -> np.ndarray:
    """∂pixels by everything a camera's views depend on, (2, Q, B, N), without the residual."""
    turn, d_pose = state.camera_from_reference[camera, :3, :3], predicted.d_pose
    d_turn, d_shift = d_pose[:, :3], d_pose[:, 3:]
    parts = [np.einsum("caij,ab->cbij", d_turn, turn), np.einsum("caij,ab->cbij", d_shift, turn)]
    if camera > 0:
        middle = placed(state.reference_from_target[moments], problem.features.board.middle)
        arm = (middle @ turn.T).T[..., None]  # R s, (3, B, 1)
        parts += [d_turn + turn_jacobian(arm, d_shift), d_shift]
    parts.append(predicted.d_camera[:, problem.views[camera].free])
    if problem.warp_free:
        fields = problem.shape.fields[:, : predicted.d_local.shape[1]][block.points]
        parts.append(np.einsum("rlbn,bnlk->rkbn", predicted.d_local, fields, optimize=True))
    return np.concatenate(parts, axis=1)


def _stepped(problem: RigProblem, state: RigState, step: Step) -> RigState | None:
    if not (np.isfinite(step.pose).all() and np.isfinite(step.shared).all()):
        return None
    poses = state.camera_from_reference.copy()
    poses[1:] = moved_poses(poses[1:], step.shared[: problem.pose_size].reshape(-1, 6))
    cameras = []
    for number, camera in enumerate(state.cameras):
        parameters = camera.parameters.copy()
        parameters[problem.views[number].free] += step.shared[problem.parameter_columns(number)]
        try:
            cameras.append(camera.with_parameters(parameters))
        except InputError:
            return None
    warp = state.board_warp + step.shared[-len(WARP_NAMES) :] if problem.warp_free else state.board_warp
    moments = moved_poses(state.reference_from_target, step.pose, problem.features.board.middle)
    return RigState(tuple(cameras), poses, moments, warp)
