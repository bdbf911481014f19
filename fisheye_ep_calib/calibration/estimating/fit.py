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
from fisheye_ep_calib.calibration.estimating.normal_equations import NormalEquations, view_clustering
from fisheye_ep_calib.calibration.estimating.prediction import FeatureModel
from fisheye_ep_calib.calibration.estimating.robust import LINEAR, Loss, noise_variance, robust_spread
from fisheye_ep_calib.calibration.estimating.settled import settled_equations
from fisheye_ep_calib.calibration.estimating.view_effects import ViewEffects
from fisheye_ep_calib.calibration.estimating.views import ViewBlock, view_blocks
from fisheye_ep_calib.calibration.observations import Observations
from fisheye_ep_calib.calibration.structure import LENS, Structure
from fisheye_ep_calib.camera.pupils import CENTRAL_MODEL
from fisheye_ep_calib.errors import CalibrationError
from fisheye_ep_calib.target.shape.bow import WARP_NAMES
from fisheye_ep_calib.target.shape.frame import board_frame
from fisheye_ep_calib.target.shape.model import BOW, FREE, ShapeModel, bow_model, flat_model

MIN_VIEWS = 3
MIN_POINTS = 4  # sightings a view needs for its pose
_ON_A_LINE = 1e-6  # variance of a view's points across, over that along; such a view may turn about its line
_AT_THE_LIMIT = 0.98  # of the largest angle allowed: a fit that comes so near may be held there
_FAR_OFF = 1e-3  # of the image: a median residual above it lets other first guesses be tried
_CLOSE = 1e-6  # tolerance of a fit with many unknowns; the step that falls below it is taken, which leaves far less
_SURE = 3.0  # standard errors beyond which residuals are taken to hang together
_ROUGH = 1e-2  # tolerance of the stage that only serves as a start


@dataclass(frozen=True)
class Sightings:
    """Observations made ready for fitting. images (V,): the image numbers of the pose array.

    target: as its file has it, or as it was measured before. free: what its shape may be where it is estimated, with
    the variances of the data; None until they are known. effects: what is let differ from view to view.
    """

    observations: Observations
    images: np.ndarray
    blocks: tuple[ViewBlock, ...]
    features: FeatureModel
    target: ShapeModel
    loss: Loss = LINEAR
    free: ShapeModel | None = None
    effects: ViewEffects | None = None

    def shape_model(self, kind: str) -> ShapeModel:
        """What a structure's ``board_shape`` lets the target be."""
        if kind == FREE and self.free is not None:
            return self.free
        return bow_model(self.target) if kind == BOW else self.target

    @cached_property
    def point_count(self) -> int:
        return int(self.view_counts.sum())

    @cached_property
    def view_counts(self) -> np.ndarray:
        """Points used in each view (V,)."""
        counts = np.zeros(len(self.images), dtype=int)
        for block in self.blocks:
            counts[block.views] = (block.weights > 0).sum(axis=-1)
        return counts

    @cached_property
    def usual_weight(self) -> float:
        """What turns pixels into the unit of weighted residuals; weights may be 1/σ."""
        weights = self.observations.weights
        return float(np.median(weights[weights > 0]))


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
        penalised = self.problem.shape_size or self.problem.effects
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
        return 2 * self.sightings.point_count - 6 * len(self.sightings.images) - self.problem.shared_size

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
        freedom = self.degrees_of_freedom - round(self.problem.shape.freedom) * (self.problem.shape_size > 0)
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


def sightings_of(observations: Observations, disc_centers: str = "unbiased") -> Sightings:
    """The images with enough sightings for a pose.

    disc_centers: "unbiased" predicts centres of gravity of projected discs, "naive" images of their centres.
    """
    images = _images_with_points(observations)
    radius = observations.disc_radius if disc_centers == "unbiased" else None
    features = FeatureModel(board_frame(observations.object_points), radius)
    board = observations.board
    target = flat_model(observations.object_points, None if board is None else board.local)
    return Sightings(observations, images, view_blocks(observations, images), features, target)


def prepare(observations: Observations, disc_centers: str = "unbiased") -> Sightings:
    """``sightings_of`` for a calibration. Raises CalibrationError where too few images remain."""
    sightings = sightings_of(observations, disc_centers)
    if len(sightings.images) < MIN_VIEWS:
        raise CalibrationError(
            f"{_count(len(sightings.images), 'view has', 'views have')} at least {MIN_POINTS} points, not on one line; "
            f"at least {MIN_VIEWS} are needed, and 20 or more for a good calibration: record more views"
        )
    return sightings


def with_weights(sightings: Sightings, weights: np.ndarray) -> Sightings:
    """The same sightings under other weights (M,); views that lose too many points are left out."""
    observations = replace(sightings.observations, weights=weights)
    images = _images_with_points(observations)
    if len(images) < MIN_VIEWS:
        raise CalibrationError(
            f"only {_count(len(images), 'view remains', 'views remain')} once wrong points are left out; "
            "check that the target file describes the board in the images"
        )
    return replace(sightings, observations=observations, images=images, blocks=view_blocks(observations, images))


def of_images(sightings: Sightings, images: np.ndarray) -> Sightings:
    """Some of the images alone; observation rows keep their places."""
    return replace(sightings, images=images, blocks=view_blocks(sightings.observations, images))


def why_no_pose(observations: Observations, image: int) -> str:
    """Why ``sightings_of`` left out an image that was observed."""
    count = int(((observations.image_index == image) & (observations.weights > 0)).sum())
    return f"fewer than {MIN_POINTS} points" if count < MIN_POINTS else "its points lie on one line"


def _images_with_points(observations: Observations) -> np.ndarray:
    """Image numbers (V,), sorted, of the images with enough points for a pose, not all of them on one line."""
    used = observations.weights > 0
    images, view, counts = np.unique(observations.image_index[used], return_inverse=True, return_counts=True)
    points = observations.object_points[observations.point_index[used]]
    points = points - observations.object_points.mean(axis=0)
    scatter = np.empty((len(images), 3, 3))
    middle = np.stack([np.bincount(view, points[:, i]) for i in range(3)], axis=-1) / counts[:, None]
    for i in range(3):
        for j in range(i + 1):
            products = np.bincount(view, points[:, i] * points[:, j]) / counts
            scatter[:, i, j] = scatter[:, j, i] = products - middle[:, i] * middle[:, j]
    spread = np.linalg.eigvalsh(scatter)
    return images[(counts >= MIN_POINTS) & (spread[:, 1] > _ON_A_LINE * spread[:, 2])]


def _count(number: int, singular: str, plural: str) -> str:
    return f"{number} {singular if number == 1 else plural}"


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
    )
    shape = model.state_like(start.problem.shape, state.shape)
    if sightings.effects is None:
        return problem, AdjustmentState(camera, poses, shape)
    effects = sightings.effects.state_like(start.problem.effects, state.effects, len(state.camera_from_target))
    return problem, AdjustmentState(camera, poses, shape, effects[position])


def adjusted(
    structure: Structure,
    sightings: Sightings,
    problem: AdjustmentProblem,
    state: AdjustmentState,
    tolerance: float = CONVERGED,
) -> Fit:
    """Adjust to convergence, with a wider limit of the incidence angle where the fit comes near it.

    A start far from the truth (pixels that are not square, a centre far off) may have set the limit too low.
    """
    first = adjust(problem, state, tolerance=tolerance, first_damping=CONFIDENT)
    fit = Fit(structure, sightings, problem, first)
    while problem.theta_limit < np.pi and np.nanmax(fit.residuals[1]) > _AT_THE_LIMIT * problem.theta_limit:
        problem = replace(problem, theta_limit=float(min(np.pi, 1.2 * problem.theta_limit + 0.1)))
        fit = Fit(structure, sightings, problem, adjust(problem, fit.state, tolerance=tolerance))
    return fit
