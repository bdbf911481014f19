"""k-fold cross-validation over places: how well a camera predicts boards that it was not fitted to.

For each fold the camera is fitted to the other views; then, with that camera frozen, the fold's poses alone are
refitted and the residuals counted. Random halves of one set do not show an error that all distances share:
assessing/near_far.py splits near against far for that.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from fisheye_ep_calib.arrays import FloatArray, IntArray
from fisheye_ep_calib.calibration.estimating.adjustment import Adjustment, adjust, evaluate, residuals, stepped
from fisheye_ep_calib.calibration.estimating.fit import Fit, refine, weighted_square
from fisheye_ep_calib.calibration.estimating.normal_equations import ALMOST_UNDAMPED, NormalEquations, solve_damped
from fisheye_ep_calib.calibration.estimating.sightings import of_images
from fisheye_ep_calib.calibration.selecting.independent_views import places
from fisheye_ep_calib.calibration.structure import Structure
from fisheye_ep_calib.target.shape.model import FLAT, FREE

FOLDS = 5
_FAR_STEP = 0.02  # share of the cost: a larger step than this is followed by further ones
_FAR_STEP_OF_SHAPE = 0.3  # residuals are linear in a target's shape, which takes most of such a step


@dataclass(frozen=True)
class CrossValidation:
    """square (K,): sums of squared held-out residuals of each fold, px²; count (K,): points in each.

    loss (K,): sums of their loss ρ, px². It is what models are compared by; but for a robust loss it is ``square``.
    """

    square: np.ndarray
    loss: np.ndarray
    count: np.ndarray

    @property
    def rms_px(self) -> float:
        return float(np.sqrt(self.square.sum() / self.count.sum()))

    @property
    def mean_loss(self) -> float:
        """px² a point."""
        return float(self.loss.sum() / self.count.sum())

    def fold_log_ratios(self, other: CrossValidation) -> np.ndarray:
        """½ ln(own / other loss) of each fold (K,); negative where this one is better."""
        gain: FloatArray = 0.5 * np.log(np.maximum(self.loss, 1e-300) / np.maximum(other.loss, 1e-300))
        return gain

    def log_ratio(self, other: CrossValidation) -> tuple[float, float]:
        """Mean of ``fold_log_ratios`` and its standard error.

        Ratios a fold, not differences: one fold may hold the close-ups and with them all of the difference.
        """
        ratio = self.fold_log_ratios(other)
        return float(ratio.mean()), float(ratio.std(ddof=1) / np.sqrt(len(ratio)))


def fold_of_view(place: np.ndarray) -> np.ndarray:
    """Fold number (V,) of each view, by the place (V,) of each: a fixed shuffle that does not follow the recording.

    Folds are over places: a twin of a left-out view among the others would answer for it. Fewer than ten places are
    left out one by one.
    """
    count = int(place.max()) + 1
    if count < 2:
        place, count = np.arange(len(place)), len(place)
    folds = FOLDS if count >= 2 * FOLDS else count
    number = np.empty(count, dtype=int)
    number[np.random.default_rng(0).permutation(count)] = np.arange(count) % folds
    of_view: IntArray = number[place]
    return of_view


def cross_validate(fit: Fit) -> CrossValidation:
    """Cross-validate a fit's structure; the folds are the same for every structure on the same views."""
    number = fold_of_view(places(fit.sightings))
    errors = [held_out_error(fit_without(fit, number == fold), fit, number == fold) for fold in np.unique(number)]
    return CrossValidation(*np.array(errors, dtype=float).T)


def fit_without(fit: Fit, left_out: np.ndarray) -> Adjustment:
    """The fit to the other views alone.

    One Gauss–Newton step on their normal equations, which are known at the full fit, is exact to second order in
    what the left-out views contributed; where it is a long one the adjustment goes on from there.
    """
    equations = _equations_without(fit, left_out)
    sightings = of_images(fit.sightings, fit.sightings.images[~left_out])
    problem = replace(fit.problem, blocks=sightings.blocks)
    state = fit.state.of_views(~left_out)
    try:
        step = solve_damped(equations, ALMOST_UNDAMPED)
    except np.linalg.LinAlgError:  # the other views alone leave something open
        return adjust(problem, state, tolerance=1e-6)
    far = _FAR_STEP_OF_SHAPE if problem.shape_size else _FAR_STEP
    trial = stepped(problem, state, step)
    if trial is None or step.predicted_decrease > far * equations.cost:
        return adjust(problem, state, tolerance=1e-6)
    return Adjustment(trial, equations, 1, True)


def _equations_without(fit: Fit, left_out: np.ndarray) -> NormalEquations:
    """The other views' normal equations at the full fit; what all views say of the shape is known as a sum only.

    Where all views together have no gradient left, that of the others is what the left-out ones pull, turned round.
    """
    whole = fit.adjustment.equations
    if whole.shape is None:
        return whole.of_views(~left_out)
    part = of_images(fit.sightings, fit.sightings.images[left_out])
    gone = evaluate(replace(fit.problem, blocks=part.blocks), fit.state.of_views(left_out), penalised=False)
    assert gone.shape is not None
    shape = replace(whole.shape.minus(gone.shape, ~left_out), gradient=-gone.shape.gradient)
    by_view, own = whole.by_view[~left_out], slice(whole.view_size, -1)
    by_view[:, :-1, -1] = by_view[:, -1, :-1] = 0.0
    by_view[0, own, -1] = by_view[0, -1, own] = -gone.shared_gradients.sum(axis=0)
    return replace(whole, by_view=by_view, cost=whole.cost - gone.cost, shape=shape, prior_gradient=0.0)


def held_out_error(trained: Adjustment, fit: Fit, held_out: np.ndarray) -> tuple[float, float, int]:
    """Sums of squared residuals and of their loss, px², and number of points of the held-out views.

    Poses are refitted, the camera is frozen.
    """
    sightings = of_images(fit.sightings, fit.sightings.images[held_out])
    problem = replace(
        fit.problem,
        blocks=sightings.blocks,
        free=np.zeros_like(fit.problem.free),
        shape_free=False,
        prior=None,
    )
    own = fit.state.of_views(held_out)
    state = replace(trained.state, camera_from_target=own.camera_from_target, effects=own.effects)
    refitted = adjust(problem, state, tolerance=1e-5, last_step=False)
    loss = square = 2 * refitted.equations.cost
    if problem.loss.kind != "linear" or problem.effects:
        error, _, _ = residuals(problem, refitted.state, len(sightings.observations.pixels))
        square = float(weighted_square(error, sightings.observations.weights).sum())
        loss = square if problem.loss.kind == "linear" else loss
    return square, loss, sightings.point_count


def shape_predicts(shaped: Fit, structure: Structure) -> tuple[bool, tuple[str, ...]]:
    """Whether folds over views agree that a fit with a free shape predicts better than the same with none, and why.

    They agree where the gain, as mean of ln(RMS ratio) over the folds, exceeds its standard error, or where the ratios'
    signed ranks do (Wilcoxon, Biometrics Bulletin 1, 1945): with the camera of a structure, or with the richest, beside
    which the shape was estimated. A camera may extrapolate so wildly to a fold that alone reaches the rim that nothing
    of the board is seen there.
    """
    if not shaped.problem.shape_size:
        return False, ("board shape left out: the data say nothing of one",)
    for camera in dict.fromkeys((structure, shaped.structure)):
        bent = refine(shaped, replace(camera, board_shape=FREE))
        flat = refine(bent, replace(camera, board_shape=FLAT))
        with_shape, without = cross_validate(bent), cross_validate(flat)
        gain, error = with_shape.log_ratio(without)
        kept = -gain > error or _signed_rank(with_shape.fold_log_ratios(without)) < -1
        if kept:
            break
    percent = 100 * (1 - np.exp(gain))
    word = "kept" if kept else "left out"
    return kept, (f"board shape {word}: held-out error {percent:+.2f} % better ± {100 * error:.2f} %",)


def _signed_rank(values: np.ndarray) -> float:
    """Wilcoxon's sum of signed ranks of values (n,) over its standard deviation were both signs alike."""
    rank = np.argsort(np.argsort(np.abs(values))) + 1
    return float((np.sign(values) * rank).sum() / np.sqrt((rank**2).sum()))
