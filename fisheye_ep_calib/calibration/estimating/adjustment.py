"""Levenberg–Marquardt bundle adjustment of camera, target shape and one pose a view."""

from __future__ import annotations

from dataclasses import dataclass, field, replace

import numpy as np

from fisheye_ep_calib.arrays import FloatArray
from fisheye_ep_calib.calibration.estimating.levenberg_marquardt import (
    CAUTIOUS,
    CONVERGED,
    MOST_ITERATIONS,
    minimise,
)
from fisheye_ep_calib.calibration.estimating.normal_equations import NormalEquations, Step
from fisheye_ep_calib.calibration.estimating.prediction import FeatureModel, Prediction, predict
from fisheye_ep_calib.calibration.estimating.robust import LINEAR, Loss
from fisheye_ep_calib.calibration.estimating.shape_products import ShapeProducts
from fisheye_ep_calib.calibration.estimating.view_effects import ViewEffects
from fisheye_ep_calib.calibration.estimating.views import ViewBlock
from fisheye_ep_calib.camera import FisheyeCamera
from fisheye_ep_calib.errors import InputError
from fisheye_ep_calib.rotation import moved_poses
from fisheye_ep_calib.target.shape.model import FREE, ShapeModel, ShapeState, Surface

_LARGEST_KEPT = 2**24  # bytes


@dataclass(frozen=True)
class AdjustmentState:
    """What is estimated. camera_from_target (V, 4, 4): metres. shape: of the target.

    effects (V, k): coefficients of what is each view's own (view_effects.py).
    """

    camera: FisheyeCamera
    camera_from_target: np.ndarray
    shape: ShapeState
    effects: np.ndarray = field(default_factory=lambda: np.zeros((0, 0)))

    def of_views(self, views: np.ndarray) -> AdjustmentState:
        """With some of the views alone."""
        effects = self.effects[views] if len(self.effects) else self.effects
        return replace(self, camera_from_target=self.camera_from_target[views], effects=effects)


@dataclass(frozen=True)
class AdjustmentProblem:
    """What is seen and what is free.

    free: bool (P,), which of camera.parameters are estimated. shape: what the target may be; shape_free: whether it is
    estimated or held. theta_limit: rad, the largest incidence angle that a trial camera may give a sighting.
    effects: what may differ from view to view beside the pose. prior (P, P): of camera.parameters about zero, the
    inverse of their covariance times σ², px² by their units; None where nothing is known beforehand.
    """

    blocks: tuple[ViewBlock, ...]
    features: FeatureModel
    free: np.ndarray
    shape: ShapeModel
    shape_free: bool = True
    theta_limit: float = np.pi
    loss: Loss = LINEAR
    effects: ViewEffects | None = None
    prior: np.ndarray | None = None

    @property
    def view_size(self) -> int:
        """Unknowns of each view: its pose, and what else is its own."""
        return 6 + (self.effects.size if self.effects else 0)

    @property
    def bow_size(self) -> int:
        """Coefficients of the shape that stand among the camera's: those without a penalty."""
        return self.shape.smooth_size if self.shape_free and self.shape.kind != FREE else 0

    @property
    def shape_size(self) -> int:
        """Unknowns of the shape that have equations of their own."""
        return self.shape.size if self.shape_free and self.shape.kind == FREE else 0

    @property
    def shared_size(self) -> int:
        return int(self.free.sum()) + self.bow_size

    @property
    def known_size(self) -> int:
        """How many of the shared parameters have a prior."""
        return 0 if self.prior is None else int((np.diag(self.prior)[self.free] > 0).sum())

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


def evaluate(
    problem: AdjustmentProblem, state: AdjustmentState, penalised: bool = True, follow: np.ndarray | None = None
) -> NormalEquations:
    """The normal equations at a state.

    penalised: with the penalty of a free shape. follow (K, S): how a shape that is held follows the shared parameters.
    """
    columns, has_discs = problem.view_size + problem.shared_size + 1, problem.features.disc_radius is not None
    hessian = np.zeros((problem.view_count, columns, columns))
    collected = None
    if problem.shape_size:
        sizes = (problem.view_count, problem.view_size, problem.shared_size)
        collected = ShapeProducts(problem.shape, *sizes, has_discs)
    effects = problem.effects
    surface = problem.shape.surface(state.shape)
    following = None if follow is None else problem.shape.local_change(follow)
    cost, valid = 0.0, True
    for block in problem.blocks:
        local = bool(problem.bow_size or problem.shape_size or follow is not None or effects)
        predicted = predict_block(problem, state, surface, block, jacobian=True, local_jacobian=local)
        used = block.weights > 0
        valid = valid and bool(predicted.valid[used].all())
        error = predicted.pixels - block.pixels
        weights = np.where(predicted.valid, block.weights, 0.0)
        loss, factor = problem.loss.evaluate((error[0] ** 2 + error[1] ** 2) * weights**2)
        cost += 0.5 * float(loss[used].sum())
        weights *= factor
        shared = shared_jacobian(problem, block, predicted)
        if following is not None:
            change = following[:, : predicted.d_local.shape[1]][block.points]
            shared = shared + np.einsum("rlbn,bnlk->rkbn", predicted.d_local, change, optimize=True)
        own = predicted.d_pose
        if effects:
            own = np.concatenate([own, effects.columns(block, predicted)], axis=1)
        parts = [own, shared, error[:, None]]
        hessian[block.views] = _products(parts, weights, columns)
        if collected:
            collected.add(block, parts, predicted.d_local, weights)
    shape = collected.equations() if collected else None
    if shape and penalised:
        values, penalty = state.shape.vector, problem.shape.all_penalties
        shape = shape.penalised(penalty, values)
        cost += 0.5 * float(penalty @ values**2)
    if effects:
        penalise_effects(hessian, effects.penalty, state.effects)
        cost += 0.5 * float((effects.penalty * state.effects**2).sum())
    equations = NormalEquations(hessian, cost, valid and bool(np.isfinite(cost)), shape, view_size=problem.view_size)
    return equations if problem.prior is None else _with_prior(equations, problem, state.camera)


def _with_prior(equations: NormalEquations, problem: AdjustmentProblem, camera: FisheyeCamera) -> NormalEquations:
    """With ½ cᵀ Λ c of the camera's parameters c: its information and its gradient stand beside those of the views."""
    assert problem.prior is not None
    free = int(problem.free.sum())
    information, gradient = np.zeros((problem.shared_size,) * 2), np.zeros(problem.shared_size)
    information[:free, :free] = problem.prior[np.ix_(problem.free, problem.free)]
    pull = problem.prior @ camera.parameters
    gradient[:free] = pull[problem.free]
    cost = equations.cost + 0.5 * float(camera.parameters @ pull)
    return replace(equations, cost=cost, prior=information, prior_gradient=gradient)


def predict_block(
    problem: AdjustmentProblem, state: AdjustmentState, surface: Surface, block: ViewBlock, **wanted: bool
) -> Prediction:
    """``predict`` for a block at a state; surface: of the state's shape."""
    change = problem.effects.change(block, state.effects[block.views]) if problem.effects else None
    poses = state.camera_from_target[block.views]
    return predict(state.camera, problem.features, surface, poses, block, problem.theta_limit, change=change, **wanted)


def penalise_effects(by_view: np.ndarray, penalty: np.ndarray, values: np.ndarray) -> None:
    """Add ½ Σ λ b² of every view's own unknowns b (V, k), behind the pose, to its JᵀJ (V, 6 + k + S + 1, same)."""
    own = 6 + np.arange(len(penalty))
    by_view[:, own, own] += penalty
    by_view[:, own, -1] += penalty * values
    by_view[:, -1, own] += penalty * values


def shared_jacobian(problem: AdjustmentProblem, block: ViewBlock, prediction: Prediction) -> np.ndarray:
    """∂pixels/∂(free camera parameters, bow), (2, S, B, N)."""
    columns = prediction.d_camera if problem.free.all() else prediction.d_camera[:, problem.free]
    if not problem.bow_size:
        return columns
    fields = problem.shape.fields[:, : prediction.d_local.shape[1]][block.points]
    return np.concatenate([columns, np.einsum("rlbn,bnlk->rkbn", prediction.d_local, fields, optimize=True)], axis=1)


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
    products: FloatArray = rows @ rows.transpose(0, 2, 1)
    return products


def residuals(
    problem: AdjustmentProblem, state: AdjustmentState, count: int
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Predicted minus measured pixels (count, 2), incidence angles (count,) and validity, by observation row.

    Rows that no block holds stay NaN and invalid.
    """
    result = np.full((count, 2), np.nan)
    theta = np.full(count, np.nan)
    valid = np.zeros(count, dtype=bool)
    surface = problem.shape.surface(state.shape)
    for block in problem.blocks:
        predicted = predict_block(problem, state, surface, block)
        rows = block.rows[block.real]
        result[rows] = (predicted.pixels - block.pixels)[:, block.real].T
        theta[rows] = predicted.theta[block.real]
        valid[rows] = predicted.valid[block.real]
    return result, theta, valid


def stepped(problem: AdjustmentProblem, state: AdjustmentState, step: Step) -> AdjustmentState | None:
    """The state after a step, or None where it is no camera."""
    parameters = state.camera.parameters.copy()
    free_count = int(problem.free.sum())
    parameters[problem.free] += step.shared[:free_count]
    if not (np.isfinite(parameters).all() and np.isfinite(step.pose).all()):
        return None
    shape = state.shape.moved(step.shared[free_count:]) if problem.bow_size or problem.shape_size else state.shape
    try:
        camera = state.camera.with_parameters(parameters)
    except InputError:
        return None
    poses = moved_poses(state.camera_from_target, step.pose[:, :6], problem.features.board.middle)
    effects = state.effects + step.pose[:, 6:] if problem.effects else state.effects
    return AdjustmentState(camera, poses, shape, effects)


def adjust(
    problem: AdjustmentProblem,
    state: AdjustmentState,
    max_iterations: int = MOST_ITERATIONS,
    tolerance: float = CONVERGED,
    last_step: bool = True,
    first_damping: float = CAUTIOUS,
    unchecked: float = CONVERGED,
) -> Adjustment:
    """Minimise the cost from a state on (levenberg_marquardt.py)."""
    # glibc gives large blocks back to the system as they are freed, so that every evaluation would fault its pages in
    # anew: half of the time. "Large" is what exceeds the largest block freed so far; this one is never touched.
    np.empty(_LARGEST_KEPT, dtype=np.uint8)
    minimum = minimise(
        lambda trial: evaluate(problem, trial),
        lambda current, step: stepped(problem, current, step),
        state,
        max_iterations,
        tolerance,
        last_step,
        first_damping,
        unchecked,
    )
    return Adjustment(minimum.state, minimum.equations, minimum.iterations, minimum.converged)
