"""Levenberg–Marquardt bundle adjustment of camera, board warp and one pose a view."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from fisheye_ep_calib.calibration.estimating.levenberg_marquardt import (
    CAUTIOUS,
    CONVERGED,
    MOST_ITERATIONS,
    minimise,
)
from fisheye_ep_calib.calibration.estimating.normal_equations import NormalEquations
from fisheye_ep_calib.calibration.estimating.prediction import FeatureModel, predict
from fisheye_ep_calib.calibration.estimating.robust import LINEAR, Loss
from fisheye_ep_calib.calibration.estimating.views import ViewBlock
from fisheye_ep_calib.camera import FisheyeCamera
from fisheye_ep_calib.errors import InputError
from fisheye_ep_calib.rotation import moved_poses
from fisheye_ep_calib.target.shape.bow import WARP_NAMES

_LARGEST_KEPT = 2**24  # bytes


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
        error = found.pixels - block.pixels
        weights = np.where(found.valid, block.weights, 0.0)
        loss, factor = problem.loss.evaluate((error[0] ** 2 + error[1] ** 2) * weights**2)
        cost += 0.5 * float(loss[used].sum())
        weights *= factor
        d_camera = found.d_camera if len(free) == found.d_camera.shape[1] else found.d_camera[:, free]
        parts = [found.d_pose, d_camera, *([found.d_warp] if problem.warp_free else []), error[:, None]]
        hessian[block.views] = _products(parts, weights, columns)
    return NormalEquations(hessian, cost, valid and bool(np.isfinite(cost)))


def _products(parts: list[np.ndarray], weights: np.ndarray, columns: int) -> np.ndarray:
    """JᵀJ (B, C, C) of each view for weighted columns: parts (2, Q, B, N), C in all, and weights (B, N)."""
    views, slots = weights.shape
    system = np.empty((views, columns, 2, slots))
    first = 0
    for part in parts:
        last = first + part.shape[1]
        np.multiply(part.transpose(2, 1, 0, 3), weights[:, None, None], out=system[:, first:last])
        first = last
    rows = system.reshape(views, columns, 2 * slots)
    return rows @ rows.transpose(0, 2, 1)


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
    first_damping: float = CAUTIOUS,
) -> Adjustment:
    """Minimise the cost from a state on (levenberg_marquardt.py)."""
    # glibc gives large blocks back to the system as they are freed, so that every evaluation would fault its pages in
    # anew: half of the time. "Large" is what exceeds the largest block freed so far; this one is never touched.
    np.empty(_LARGEST_KEPT, dtype=np.uint8)
    found = minimise(
        lambda trial: evaluate(problem, trial),
        lambda current, step: stepped(problem, current, step),
        state,
        max_iterations,
        tolerance,
        last_step,
        first_damping,
    )
    return Adjustment(found.state, found.equations, found.iterations, found.converged)
