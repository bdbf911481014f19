"""Levenberg–Marquardt bundle adjustment of camera, board warp and one pose a view."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from fisheye_ep_calib.calibration.estimating.levenberg_marquardt import CONVERGED, MOST_ITERATIONS, minimise
from fisheye_ep_calib.calibration.estimating.normal_equations import NormalEquations
from fisheye_ep_calib.calibration.estimating.prediction import FeatureModel, predict
from fisheye_ep_calib.calibration.estimating.robust import LINEAR, Loss
from fisheye_ep_calib.calibration.estimating.views import ViewBlock
from fisheye_ep_calib.camera import FisheyeCamera
from fisheye_ep_calib.errors import InputError
from fisheye_ep_calib.rotation import moved_poses
from fisheye_ep_calib.target.shape.bow import WARP_NAMES

# glibc gives large blocks back to the system as they are freed, so that every evaluation would fault its pages in anew:
# half of the time. "Large" is what exceeds the largest block freed so far; this one is never touched.
np.empty(2**24, dtype=np.uint8)


@dataclass(frozen=True)
class AdjustmentState:
    """What is estimated. board_warp (3,): metres. camera_from_target (V, 4, 4)."""

    camera: FisheyeCamera
    camera_from_target: np.ndarray
    board_warp: np.ndarray = field(default_factory=lambda: np.zeros(len(WARP_NAMES)))


@dataclass(frozen=True)
class AdjustmentProblem:
    """What is seen and what is free.

    free: bool (P,), which of camera.parameters are estimated. theta_limit: rad, the largest
    incidence angle that a trial camera may give a sighting.
    """

    blocks: tuple[ViewBlock, ...]
    features: FeatureModel
    free: np.ndarray
    warp_free: bool = False
    theta_limit: float = np.pi
    loss: Loss = LINEAR

    @property
    def shared_size(self) -> int:
        return int(self.free.sum()) + len(WARP_NAMES) * self.warp_free

    @property
    def view_count(self) -> int:
        return sum(len(block.views) for block in self.blocks)


@dataclass(frozen=True)
class Adjustment:
    """Where the adjustment ended. equations: the undamped normal equations there."""

    state: AdjustmentState
    equations: NormalEquations
    iterations: int
    converged: bool


def evaluate(problem: AdjustmentProblem, state: AdjustmentState) -> NormalEquations:
    """The normal equations at a state."""
    views, size = problem.view_count, problem.shared_size
    columns = 6 + size + 1
    hessian = np.zeros((views, columns, columns))
    free = np.flatnonzero(problem.free)
    cost, valid = 0.0, True
    for block in problem.blocks:
        found = predict(
            state.camera,
            problem.features,
            state.board_warp,
            state.camera_from_target[block.views],
            block,
            problem.theta_limit,
            jacobian=True,
            warp_jacobian=problem.warp_free,
        )
        used = block.weights > 0
        valid = valid and bool(found.valid[used].all())
        system = np.empty((2, columns, *block.weights.shape))
        system[:, :6] = found.d_pose
        for column, parameter in enumerate(free, start=6):
            system[:, column] = found.d_camera[:, parameter]
        if problem.warp_free:
            system[:, 6 + len(free) : 6 + size] = found.d_warp
        np.subtract(found.pixels, block.pixels, out=system[:, -1])
        weights = np.where(found.valid, block.weights, 0.0)
        square = (system[0, -1] ** 2 + system[1, -1] ** 2) * weights**2
        loss, factor = problem.loss.evaluate(square)
        cost += 0.5 * float(loss[used].sum())
        system *= weights * factor
        by_view = np.swapaxes(system, 1, 2)
        products = by_view[0] @ np.swapaxes(by_view[0], 1, 2)
        products += by_view[1] @ np.swapaxes(by_view[1], 1, 2)
        hessian[block.views] = products
    return NormalEquations(hessian, cost, valid and bool(np.isfinite(cost)))


def residuals(problem: AdjustmentProblem, state: AdjustmentState, count: int):
    """Predicted minus measured pixels (count, 2), incidence angles (count,) and validity, by observation row.

    Rows that no block holds stay NaN and invalid.
    """
    result = np.full((count, 2), np.nan)
    theta = np.full(count, np.nan)
    valid = np.zeros(count, dtype=bool)
    for block in problem.blocks:
        poses = state.camera_from_target[block.views]
        found = predict(state.camera, problem.features, state.board_warp, poses, block, problem.theta_limit)
        rows = block.rows[block.real]
        result[rows] = (found.pixels - block.pixels)[:, block.real].T
        theta[rows] = found.theta[block.real]
        valid[rows] = found.valid[block.real]
    return result, theta, valid


def stepped(problem: AdjustmentProblem, state: AdjustmentState, step) -> AdjustmentState | None:
    """The state after a step, or None where it is no camera."""
    parameters = state.camera.parameters.copy()
    free_count = int(problem.free.sum())
    parameters[problem.free] += step.shared[:free_count]
    if not (np.isfinite(parameters).all() and np.isfinite(step.pose).all()):
        return None
    warp = state.board_warp + step.shared[free_count:] if problem.warp_free else state.board_warp
    try:
        camera = state.camera.with_parameters(parameters)
    except InputError:
        return None
    poses = moved_poses(state.camera_from_target, step.pose, problem.features.board.middle)
    return AdjustmentState(camera, poses, warp)


def adjust(
    problem: AdjustmentProblem,
    state: AdjustmentState,
    max_iterations: int = MOST_ITERATIONS,
    tolerance: float = CONVERGED,
    last_step: bool = True,
) -> Adjustment:
    """Minimise the cost from a state on (levenberg_marquardt.py)."""
    found = minimise(
        lambda trial: evaluate(problem, trial),
        lambda current, step: stepped(problem, current, step),
        state,
        max_iterations,
        tolerance,
        last_step,
    )
    return Adjustment(found.state, found.equations, found.iterations, found.converged)
