"""One fit: the paper's three steps for one structure of the camera.

(i) the sightings, (ii) focal length and poses from nothing (initialization.py), refined as a plain Kannala–Brandt
camera, (iii) everything else from zero, all refined together.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from fisheye_ep_calib.arrays import FloatArray
from fisheye_ep_calib.calibration.estimating.adjustment import (
    Adjustment,
    AdjustmentProblem,
    AdjustmentState,
    adjust,
    residuals,
)
from fisheye_ep_calib.calibration.estimating.initialization import initial_guess
from fisheye_ep_calib.calibration.estimating.levenberg_marquardt import CONFIDENT, CONVERGED
from fisheye_ep_calib.calibration.estimating.normal_equations import (
    NormalEquations,
    reduced_information,
    view_clustering,
)
from fisheye_ep_calib.calibration.estimating.robust import Loss, noise_variance, robust_spread
from fisheye_ep_calib.calibration.estimating.settled import settled_equations
from fisheye_ep_calib.calibration.estimating.shape_equations import solve_scaled
from fisheye_ep_calib.calibration.estimating.sightings import Sightings
from fisheye_ep_calib.calibration.observations import Observations
from fisheye_ep_calib.calibration.structure import LENS, Structure
from fisheye_ep_calib.camera import FisheyeCamera
from fisheye_ep_calib.camera.pupils import CENTRAL_MODEL
from fisheye_ep_calib.errors import CalibrationError
from fisheye_ep_calib.target.shape.bow import WARP_NAMES

_AT_THE_LIMIT = 0.98  # of the largest angle allowed: a fit that comes so near may be held there
_FAR_OFF = 1e-3  # of the image: a median residual above it lets other first guesses be tried
_CLOSE = 1e-6  # tolerance of a fit with many unknowns; the step that falls below it is taken, which leaves far less
_SURE = 3.0  # standard errors beyond which residuals are taken to hang together
_NEARLY_THERE = 1e-8  # first damping where all but a little is known, and residuals are linear in most of the unknowns
_ROUGH = 1e-2  # tolerance of the stage that only serves as a start


@dataclass(frozen=True)
class Fit:
    """A fitted structure."""

    structure: Structure
    sightings: Sightings
    problem: AdjustmentProblem
    adjustment: Adjustment

    @property
    def state(self) -> AdjustmentState:
        return self.adjustment.state

    @property
    def rms_px(self) -> float:
        """√ mean(dx² + dy²) of the weighted residuals over the points used."""
        penalised = self.problem.shape_size or self.problem.effects or self.problem.prior is not None
        if self.problem.loss.kind == "linear" and not penalised:
            return float(np.sqrt(2 * self.adjustment.equations.cost / self.sightings.point_count))
        return float(np.sqrt(self.weighted_square.mean()))

    @property
    def weighted_square(self) -> np.ndarray:
        """Squared lengths (n,), px², of the weighted residuals of the points used."""
        return weighted_square(self.residuals[0], self.sightings.observations.weights)

    @property
    def median_px(self) -> float:
        """Median length of the residuals of the points used, in pixels whatever the unit of the weights."""
        return float(np.sqrt(np.median(self.weighted_square))) / self.sightings.usual_weight

    @property
    def view_rms(self) -> np.ndarray:
        """``rms_px`` of each view (V,)."""
        observations, used = self.sightings.observations, self.used
        square = (self.residuals[0][used] ** 2).sum(axis=-1) * observations.weights[used] ** 2
        view = np.searchsorted(self.sightings.images, observations.image_index[used])
        views = len(self.sightings.images)
        return np.sqrt(np.bincount(view, square, views) / np.maximum(np.bincount(view, minlength=views), 1))

    @property
    def degrees_of_freedom(self) -> int:
        """Residuals less the unknowns without a prior."""
        unknowns = self.problem.shared_size - self.problem.known_size
        return 2 * self.sightings.point_count - 6 * len(self.sightings.images) - unknowns

    @cached_property
    def settled(self) -> NormalEquations:
        """The normal equations of poses and camera alone; a free shape of the target has settled in them."""
        return settled_equations(self.problem, self.state, self.adjustment.equations)

    @property
    def noise_variance(self) -> tuple[float, float]:
        """σ², px², of one coordinate, and by how much the loss lowers the information (robust.py).

        What a free shape takes out of the residuals its penalty gives back: their sum over the degrees of freedom
        is Harville's estimate (J. Am. Stat. Assoc. 72, 1977).
        """
        if self.problem.loss.kind == "linear":
            return 2 * self.adjustment.equations.cost / max(self.degrees_of_freedom, 1), 1.0
        freedom = self.degrees_of_freedom - self.problem.known_size
        freedom -= round(self.problem.shape.freedom) * (self.problem.shape_size > 0)
        if self.problem.effects:
            freedom -= round(self.problem.effects.freedom)
        return noise_variance(self.problem.loss, self.weighted_square, freedom)

    @property
    def sigma_px(self) -> float:
        """Noise of one coordinate."""
        return float(np.sqrt(self.noise_variance[0]))

    @cached_property
    def clustering(self) -> float:
        """What multiplies the covariances where residuals of a view are surely not independent, else 1.

        A board that is not quite as its file says, or light that pulls all features one way, moves a view's points
        together: their number then promises more than they tell.
        """
        if self.problem.loss.kind != "linear" or self.problem.shared_size == 0:
            return 1.0
        ratio, sigma = view_clustering(self.settled, self.noise_variance[0])
        return ratio if ratio > 1 + _SURE * sigma else 1.0

    @property
    def shared_parameters(self) -> tuple[tuple[str, ...], np.ndarray]:
        """Names and values (S,) of the estimated camera parameters and, where estimated, the board warp."""
        camera = self.state.camera
        names = [name for name, free in zip(camera.parameter_names, self.problem.free, strict=True) if free]
        values = camera.parameters[self.problem.free]
        if not self.problem.bow_size:
            return tuple(names), values
        return (*names, *WARP_NAMES), np.concatenate([values, self.state.shape.smooth])

    @cached_property
    def residuals(self) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Predicted minus measured pixels (M, 2), incidence angles (M,) rad, validity (M,), by observation row."""
        return residuals(self.problem, self.state, len(self.sightings.observations.pixels))

    @property
    def used(self) -> np.ndarray:
        """Which observation rows (M,) the fit rests on."""
        return self.residuals[2] & (self.sightings.observations.weights > 0)

    @property
    def largest_angle(self) -> float:
        """The largest incidence angle of a sighting used, rad."""
        return float(self.residuals[1][self.used].max())


def weighted_square(error: np.ndarray, weights: np.ndarray) -> np.ndarray:
    """Squared lengths (n,) of weighted residuals, from errors (M, 2) px and weights (M,), of those that are used."""
    square = (error**2).sum(axis=-1) * weights**2
    of_used: FloatArray = square[(weights > 0) & np.isfinite(square)]
    return of_used


def first_fit(sightings: Sightings, lens: str = LENS, robust: bool = False) -> Fit:
    """Steps (i) and (ii): a rough plain camera and poses with nothing known beforehand.

    robust: under a Cauchy loss whose scale follows the median residual, for sightings with gross errors.
    """
    fit = _first_fit(sightings, lens, robust)
    if fit.median_px < _FAR_OFF * max(sightings.observations.image_size):
        return fit
    return min(fit, _first_fit(sightings, lens, robust, wide=True), key=lambda candidate: candidate.median_px)


def _first_fit(sightings: Sightings, lens: str, robust: bool, wide: bool = False) -> Fit:
    observations = sightings.observations
    guess = initial_guess(
        sightings.blocks, sightings.features.board, observations.image_size, len(sightings.images), robust, wide
    )
    structure = Structure(CENTRAL_MODEL, lens=lens, skew=False)
    camera = structure.camera(observations.image_size, guess.focal_lengths, guess.centre)
    state = AdjustmentState(camera, guess.camera_from_target, sightings.target.start())
    # Naive centres of discs serve well enough for a start.
    features = replace(sightings.features, disc_radius=None)
    problem = AdjustmentProblem(sightings.blocks, features, structure.free(camera), sightings.target)
    if not robust:
        return Fit(structure, sightings, problem, _roughly_adjusted(problem, state))
    for _ in range(3):
        problem = _cauchy(problem, state, observations)
        adjustment = _roughly_adjusted(problem, state)
        state = adjustment.state
    return Fit(structure, sightings, problem, adjustment)


def _roughly_adjusted(problem: AdjustmentProblem, state: AdjustmentState) -> Adjustment:
    return adjust(problem, state, max_iterations=30, tolerance=_ROUGH, last_step=False)


def _cauchy(problem: AdjustmentProblem, state: AdjustmentState, observations: Observations) -> AdjustmentProblem:
    """The problem under a Cauchy loss at the scale of its present residuals."""
    error, _, _ = residuals(problem, state, len(observations.pixels))
    spread = robust_spread(np.sqrt(weighted_square(error, observations.weights)))
    return replace(problem, loss=Loss("cauchy", max(2 * spread, 1e-6)))


def refine(
    start: Fit,
    structure: Structure,
    sightings: Sightings | None = None,
    loss: Loss | None = None,
    tolerance: float = CONVERGED,
) -> Fit:
    """Step (iii): fit a structure from where another one ended, to convergence.

    sightings, loss: default to the start's sightings and to theirs. tolerance: on the cost (levenberg_marquardt.py).
    """
    sightings = sightings or start.sightings
    problem, state = opened(start, structure, sightings, loss)
    unknowns = problem.shared_size + 6 * len(sightings.images)
    if 2 * sightings.point_count <= unknowns:
        raise CalibrationError(
            f"{sightings.point_count} points give {2 * sightings.point_count} equations for {unknowns} unknowns: "
            "record more views or views with more of the target's points"
        )
    if problem.shape_size and start.problem.shape_size:
        # The camera first, with the shape as it was: its steps cost a third.
        held = replace(problem, shape_free=False)
        state = adjust(held, state, tolerance=_ROUGH, first_damping=CONFIDENT).state
        tolerance = max(tolerance, _CLOSE)
        return adjusted(structure, sightings, problem, state, tolerance, _NEARLY_THERE, unchecked=tolerance)
    return adjusted(structure, sightings, problem, state, tolerance)


def opened(
    start: Fit, structure: Structure, sightings: Sightings, loss: Loss | None = None
) -> tuple[AdjustmentProblem, AdjustmentState]:
    """A structure's problem and the state in which another's fit leaves it: what both share, the rest zero.

    sightings: the start's, or some of its images. loss: defaults to the sightings'.
    """
    state = start.state
    theta = start.residuals[1]
    camera = structure.camera_like(state.camera, float(np.nanmax(theta)))
    position = np.searchsorted(start.sightings.images, sightings.images)
    poses = state.camera_from_target[position]
    model = sightings.shape_model(structure.board_shape)
    problem = AdjustmentProblem(
        sightings.blocks,
        replace(sightings.features, target_axis=structure.target_axis),
        structure.free(camera),
        model,
        theta_limit=float(min(np.pi, 1.2 * np.nanmax(theta) + 0.1)),
        loss=loss or sightings.loss,
        effects=sightings.effects,
        prior=_known_beforehand(structure, camera, start),
    )
    shape = model.state_like(start.problem.shape, state.shape)
    if sightings.effects is None:
        return problem, AdjustmentState(camera, poses, shape)
    effects = sightings.effects.state_like(start.problem.effects, state.effects, len(state.camera_from_target))
    return problem, AdjustmentState(camera, poses, shape, effects[position])


def _known_beforehand(structure: Structure, camera: FisheyeCamera, start: Fit) -> np.ndarray | None:
    """Λ (P, P), px², of the camera's parameters; start: a fit whose residuals are nearly those to come."""
    penalties = []
    if structure.pupil_prior is not None:
        penalties.append(structure.pupil_prior.penalty(camera, start.noise_variance[0] * start.clustering))
    if structure.field_prior is not None:
        penalties.append(structure.field_prior.penalty(camera))
    return np.sum(penalties, axis=0) if penalties else None


def adjusted(
    structure: Structure,
    sightings: Sightings,
    problem: AdjustmentProblem,
    state: AdjustmentState,
    tolerance: float = CONVERGED,
    first_damping: float = CONFIDENT,
    unchecked: float = CONVERGED,
) -> Fit:
    """Adjust to convergence, with a wider limit of the incidence angle where the fit comes near it.

    A start far from the truth (pixels that are not square, a centre far off) may have set the limit too low.
    """
    first = adjust(problem, state, tolerance=tolerance, first_damping=first_damping, unchecked=unchecked)
    fit = Fit(structure, sightings, problem, first)
    while problem.theta_limit < np.pi and np.nanmax(fit.residuals[1]) > _AT_THE_LIMIT * problem.theta_limit:
        problem = replace(problem, theta_limit=float(min(np.pi, 1.2 * problem.theta_limit + 0.1)))
        fit = Fit(structure, sightings, problem, adjust(problem, fit.state, tolerance=tolerance))
    return fit


def independent_covariance(fit: Fit) -> tuple[float, np.ndarray]:
    """σ, px, of one coordinate, and σ² I⁻¹ (S, S) of the shared parameters, for residuals that are independent.

    Raises numpy.linalg.LinAlgError where the sightings leave some of them open.
    """
    variance, weight = fit.noise_variance
    information = reduced_information(fit.settled) / weight
    shared = variance * solve_scaled(information, np.eye(len(information)))
    return float(np.sqrt(variance)), 0.5 * (shared + shared.T)
