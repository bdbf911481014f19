"""Wrong sightings: found against the richest camera, so that what a poor model cannot explain is not thrown away.

A target that is not as its file says has points that look wrong in every view and are not: where its shape is to be
estimated, that is done before anything is left out, under a Huber loss where sightings may be wrong.

The rule: fit the richest structure under a Cauchy loss, take σ per axis from the upper quartile of the residuals
(real ones have heavier tails than their median tells), and leave out what lies beyond 6 σ; then fit again without
it, until the set stays the same. A view that loses more than half of its points is left out whole.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from fisheye_ep_calib.arrays import BoolArray
from fisheye_ep_calib.calibration.estimating.fit import Fit, first_fit, refine
from fisheye_ep_calib.calibration.estimating.pose_repair import repaired
from fisheye_ep_calib.calibration.estimating.robust import LINEAR, Loss, robust_spread
from fisheye_ep_calib.calibration.estimating.shape_estimate import with_estimated_shape
from fisheye_ep_calib.calibration.estimating.sightings import Sightings, with_weights
from fisheye_ep_calib.calibration.observations import Observations
from fisheye_ep_calib.calibration.structure import FREER_LENS, LENS, Structure
from fisheye_ep_calib.camera import PUPIL_FAMILIES
from fisheye_ep_calib.camera.pupils import CENTRAL_MODEL
from fisheye_ep_calib.target.shape.model import BOW, FLAT

_LIMIT = 6.0  # σ per axis; a Gaussian residual exceeds it once in 65 million
_LIMIT_SHAPED = 10.0  # once the board's own error is gone: what is left are detectors' errors, whose tails are heavy
_GROSS = 20.0  # where no camera or shape is estimated yet
_HUBER = 1.345  # σ; 95 % efficient on Gaussian residuals
_QUANTILE = 0.75
_WORST_SHARE = 0.5  # of a view's points: beyond it the whole view is wrong
_SUSPICIOUS = 1.0  # px RMS; a worse fit may have been dragged off by errors that it no longer shows
_ROUNDS = 8
DRAGGED = 20.0  # px RMS: no board bends as much
_FEW, _FAR = 0.01, 50.0  # share of the sightings, and σ: fewer and nearer ones do not move a fit that is otherwise good
_LIGHT = 0.02  # share of the squared residuals: sightings that hold less do not change the shape's variances
_HUBER_ROUNDS = 2
_ROUGH = 1e-6  # tolerance of fits of which one goes on
_LEAST_SIGMA = 0.05  # px; what lies within 6 of these is a misfit of the camera, not a wrong sighting


@dataclass(frozen=True)
class RejectedPoint:
    """view: the image's number; point: row of object_points; residual (2,) px, predicted minus measured."""

    view: int
    point: int
    residual: tuple[float, float]


@dataclass(frozen=True)
class Screening:
    """What is left to fit and what was left out. wrong_views: image numbers rejected whole."""

    start: Fit
    rejected: tuple[RejectedPoint, ...]
    wrong_views: tuple[int, ...]


def _lengths(fit: Fit, weights: np.ndarray) -> np.ndarray:
    """Residual lengths (M,), px, times weights (M,); infinite where no projection exists."""
    error, _, valid = fit.residuals
    length = np.hypot(error[:, 0], error[:, 1]) * weights
    return np.where(valid, length, np.inf)


def has_outliers(fit: Fit) -> bool:
    """Whether any sighting lies beyond the limit of a fit under the plain loss."""
    length = _lengths(fit, fit.sightings.observations.weights)[_used(fit)]
    least = _LEAST_SIGMA * fit.sightings.usual_weight
    return bool(length.max() > _limit(fit) * max(robust_spread(length, _QUANTILE), least))


def without_gross_errors(fit: Fit) -> Fit:
    """A fit without sightings that no board bends to, judged under a Cauchy loss; itself where there are none."""
    weights = fit.sightings.observations.weights
    spread = max(
        robust_spread(_lengths(fit, weights)[_used(fit)], _QUANTILE), _LEAST_SIGMA * fit.sightings.usual_weight
    )
    robust = refine(fit, fit.structure, loss=Loss("cauchy", 2 * spread))
    length = _lengths(robust, weights)
    least = _LEAST_SIGMA * fit.sightings.usual_weight
    limit = _GROSS * max(robust_spread(length[_used(robust)], _QUANTILE), least)
    if not (length[_used(robust)] > limit).any():
        return fit
    return refine(robust, fit.structure, with_weights(fit.sightings, np.where(length > limit, 0.0, weights)), LINEAR)


def _limit(fit: Fit) -> float:
    """Beyond how many σ per axis a sighting is wrong."""
    return _LIMIT_SHAPED if fit.problem.shape_size else _LIMIT


def richest_structure(structure: Structure, sightings: Sightings, board_shape: str = BOW) -> Structure:
    """The structure with everything that the data can carry: all of pupil, lens, decentering and board warp.

    A structure without a pupil, or with one that may be given more terms, is given the even one of four.
    """
    family = structure.model if board_shape == FLAT else "ep_even"
    rich = replace(
        structure,
        model=family,
        terms=PUPIL_FAMILIES[family].max_terms or None,
        lens=FREER_LENS if structure.lens == LENS else structure.lens,
        target_axis=False,
        skew=True,
        extras=tuple(dict.fromkeys((*structure.extras, "tangential"))),
        board_shape=board_shape if sightings.features.board.planar else structure.board_shape,
    )
    enough = 2 * sightings.point_count > 2 * (6 * len(sightings.images) + rich.parameter_count)
    return rich if enough else structure


def screen(start: Fit, fit: Fit) -> Screening:
    """Leave out wrong sightings. start: a first fit of all of them; fit: a structure's fit from there.

    Where the fit itself leaves nothing beyond the limit, no richer one would.
    """
    if _is_clean(fit):
        return Screening(start, (), ())
    structure = richest_structure(fit.structure, fit.sightings)
    rich = refine(start, structure)
    if _is_clean(rich):
        return Screening(start, (), ())
    if _is_nearly_clean(rich):
        return _without_outliers(fit.sightings, fit.structure, _robust(rich, structure), structure, shaped=False)
    return _screen_robustly(fit.sightings, fit.structure, structure)


def screen_with_shape(fit: Fit, families: Sequence[str]) -> Screening:
    """``screen`` with the target's shape free. The start that is given back knows the shape's variances.

    families: pupils among which the one that explains most judges; one that explains less would bend the board to it.
    """
    richest = [richest_structure(replace(fit.structure, model=name), fit.sightings, FLAT) for name in families]
    plain = min(
        (refine(fit, rich, tolerance=_ROUGH) for rich in richest),
        key=lambda candidate: candidate.adjustment.equations.cost,
    )
    if plain.rms_px < DRAGGED * fit.sightings.usual_weight:
        shaped = with_estimated_shape(plain, plain.structure)
        if _is_clean(shaped):
            return Screening(shaped, (), ())
        if _is_nearly_clean(shaped):
            return _without_outliers(fit.sightings, fit.structure, shaped, plain.structure, shaped=True)
    return _screen_robustly(fit.sightings, fit.structure, plain.structure, shaped=True)


def huber_fit(start: Fit, fit: Fit) -> Fit:
    """A start whose sightings carry a Huber loss at 1.345 σ, σ per axis from the richest structure's residuals."""
    rich = richest_structure(fit.structure, fit.sightings)
    rough = fit if _is_clean(fit) else first_fit(fit.sightings, fit.structure.lens, robust=True)
    spread = robust_spread(_lengths(rough, fit.sightings.observations.weights)[_used(rough)])
    least = _LEAST_SIGMA * fit.sightings.usual_weight
    best = repaired(refine(rough, rich, loss=Loss("cauchy", max(2 * spread, least))))
    spread = robust_spread(_lengths(best, fit.sightings.observations.weights)[_used(best)])
    loss = Loss("huber", _HUBER * max(spread, least))
    return refine(best, Structure(CENTRAL_MODEL, lens=fit.structure.lens), replace(fit.sightings, loss=loss))


def _is_clean(fit: Fit) -> bool:
    small = fit.rms_px < _SUSPICIOUS * fit.sightings.usual_weight
    return fit.adjustment.converged and small and not has_outliers(fit)


def _is_nearly_clean(fit: Fit) -> bool:
    """Whether what lies beyond the limit is too little to have moved the fit."""
    length = _lengths(fit, fit.sightings.observations.weights)[_used(fit)]
    sigma = max(robust_spread(length, _QUANTILE), _LEAST_SIGMA * fit.sightings.usual_weight)
    small = fit.rms_px < _SUSPICIOUS * fit.sightings.usual_weight and length.max() < _FAR * sigma
    return bool(fit.adjustment.converged and small and (length > _limit(fit) * sigma).mean() < _FEW)


def _screen_robustly(sightings: Sightings, structure: Structure, rich: Structure, shaped: bool = False) -> Screening:
    start = first_fit(sightings, structure.lens, robust=True)
    fit = repaired(_robust(start, rich))
    if shaped:
        fit = _huber_shape(fit, rich, _LEAST_SIGMA * sightings.usual_weight)
    return _without_outliers(sightings, structure, fit, rich, shaped)


def _robust(start: Fit, structure: Structure) -> Fit:
    """A structure under a Cauchy loss by what another fit leaves over."""
    spread = robust_spread(_lengths(start, start.sightings.observations.weights)[_used(start)])
    least = _LEAST_SIGMA * start.sightings.usual_weight
    return refine(start, structure, loss=Loss("cauchy", max(2 * spread, least)))


def _without_outliers(sightings: Sightings, structure: Structure, fit: Fit, rich: Structure, shaped: bool) -> Screening:
    """Leave out what lies beyond the limit of a fit that wrong sightings have not dragged off, until nothing does."""
    observations = sightings.observations
    least = _LEAST_SIGMA * sightings.usual_weight
    keep = observations.weights > 0
    rejected_residual = np.zeros((len(keep), 2))
    wrong: set[int] = set()
    for _ in range(_ROUNDS):
        error = fit.residuals[0]
        length = _lengths(fit, observations.weights)
        predicted = np.isfinite(error[:, 0])
        sigma = max(robust_spread(length[keep & predicted], _QUANTILE), least)
        inside = (observations.weights > 0) & predicted & (length <= _limit(fit) * sigma)
        wrong |= _wrong_views(observations, inside, fit.sightings.images)
        inside &= ~np.isin(observations.image_index, list(wrong))
        rejected_residual[predicted] = error[predicted]
        if np.array_equal(inside, keep):
            break
        square = np.where(np.isfinite(length), length, 0.0) ** 2
        light = square[inside != keep].sum() < _LIGHT * square[keep].sum()
        keep = inside
        left = with_weights(sightings, np.where(keep, observations.weights, 0.0))
        if not shaped:
            fit = refine(fit, rich, left)
        elif light and fit.problem.shape_size and fit.problem.loss == left.loss:
            fit = refine(fit, fit.structure, replace(left, free=fit.sightings.free))
        else:
            fit = with_estimated_shape(fit, rich, left, rounds=1)
    kept = fit.sightings
    # Images with too few points for a pose were never judged.
    judged = (observations.weights > 0) & np.isin(observations.image_index, sightings.images)
    rejected = tuple(
        RejectedPoint(
            int(observations.image_index[row]),
            int(observations.point_index[row]),
            (float(rejected_residual[row, 0]), float(rejected_residual[row, 1])),
        )
        for row in np.flatnonzero(judged & ~keep)
    )
    plain = fit if shaped else refine(fit, Structure(CENTRAL_MODEL, lens=structure.lens), kept)
    return Screening(plain, rejected, tuple(sorted(wrong)))


def _huber_shape(fit: Fit, rich: Structure, least: float) -> Fit:
    """The fit with the shape free, under a Huber loss: points that are off in all views move, single sightings do not.

    The scale follows the residuals, which a bent board makes large at first.
    """
    for _ in range(_HUBER_ROUNDS):
        length = _lengths(fit, fit.sightings.observations.weights)[_used(fit)]
        spread = max(robust_spread(length, _QUANTILE), least)
        fit = with_estimated_shape(fit, rich, loss=Loss("huber", _HUBER * spread))
    return fit


def _used(fit: Fit) -> np.ndarray:
    used: BoolArray = (fit.sightings.observations.weights > 0) & np.isfinite(fit.residuals[0][:, 0])
    return used


def _wrong_views(observations: Observations, inside: np.ndarray, images: np.ndarray) -> set[int]:
    """Image numbers whose share of good sightings is too small."""
    used = observations.weights > 0
    size = int(observations.image_index.max()) + 1
    counted = np.bincount(observations.image_index[used], minlength=size)
    good = np.bincount(observations.image_index[inside], minlength=size)
    return {int(image) for image in images if good[image] < _WORST_SHARE * counted[image]}
