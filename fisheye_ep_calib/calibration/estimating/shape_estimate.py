"""A target's shape estimated beside a camera: variances at one linearisation, then the adjustment under them, again."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from fisheye_ep_calib.calibration.estimating.fit import Fit, opened, refine
from fisheye_ep_calib.calibration.estimating.robust import Loss
from fisheye_ep_calib.calibration.estimating.shape_posterior import Linearisation
from fisheye_ep_calib.calibration.estimating.sightings import Sightings
from fisheye_ep_calib.calibration.structure import Structure
from fisheye_ep_calib.target.shape.model import (
    FIRST_DEVIATIONS,
    FLAT,
    FREE,
    REVIVED_DEVIATION,
    ROUGH_GROUPS,
    free_model,
    with_variances,
)
from fisheye_ep_calib.target.shape.variances import (
    Posterior,
    Variances,
    backward,
    chance_gain,
    gain_over_none,
    most_likely,
    none,
)

_ROUNDS = 3
_SETTLED = 0.1  # relative change of every τ, which its few coefficients tell to a third: the next round says the same
_NEGLIGIBLE = 1e-6  # metres: 0.005 px of a board that fills the image of a small camera
_FEW_VIEWS = 6  # below it a group must prove itself
_FALSE = 0.01  # of targets that are as their file says: how many may be given a shape
GATE = 9.5  # of −2 log-likelihood; a group of a flat board gains as much once in 160 sets
_CLOSE = 1e-5  # tolerance of a fit that the next round refines


def with_estimated_shape(
    start: Fit,
    rich: Structure,
    sightings: Sightings | None = None,
    loss: Loss | None = None,
    rounds: int = _ROUNDS,
) -> Fit:
    """A rich structure fitted with the target's shape free, the sightings knowing the variances.

    start: any fit of these images; where its shape is free, its variances are near. sightings, loss: default to the
    start's and to theirs. The structure's ``board_shape`` does not matter. A shape of which the data say nothing is
    left out: the fit is then flat. rounds: linearisations at most.
    """
    sightings = sightings or start.sightings
    structure = replace(rich, board_shape=FREE)
    space = free_model(sightings.target, _seen(sightings))
    fit, variances = start, start.problem.shape.variances
    for _ in range(rounds):
        try:
            estimate = _variances(fit, structure, replace(sightings, free=space), loss, variances)
        except np.linalg.LinAlgError:  # a fit so far off that it says nothing
            return refine(fit, replace(rich, board_shape=FLAT), sightings, loss, tolerance=_CLOSE)
        free = with_variances(space, *estimate)
        settled = variances is not None and _close(estimate[0], variances)
        variances = estimate[0]
        fit = refine(fit, structure, replace(sightings, free=free), loss, tolerance=_CLOSE)
        if settled or free.size == 0:
            break
    return fit


def linearised(fit: Fit) -> Linearisation:
    """What a fit with a free shape says of it, in the groups that the fit has."""
    return Linearisation(fit.problem, fit.state, fit.sightings.point_count)


def _variances(
    fit: Fit, structure: Structure, sightings: Sightings, loss: Loss | None, near: Variances | None
) -> tuple[Variances, Posterior]:
    """Most likely at the linearisation of a fit. near: those of a linearisation nearby."""
    problem, state = opened(fit, structure, sightings, loss)
    linearisation = Linearisation(problem, state, sightings.point_count)
    if near is None or not near.deviation.any():
        estimate = most_likely(linearisation, Variances(FIRST_DEVIATIONS.copy(), fit.sigma_px))
    else:
        # What was left out there is given another chance.
        start = replace(near, deviation=np.maximum(near.deviation, REVIVED_DEVIATION))
        estimate = most_likely(linearisation, start, from_nothing=False)
    gain = gain_over_none(linearisation.likelihood, *estimate)
    if gain < GATE:
        return none(estimate[0]), linearisation(none(estimate[0]))
    # Many groups together gain by chance what none of them would: then each must prove itself.
    groups = len(np.unique(problem.shape.group)) + len(ROUGH_GROUPS)
    if len(sightings.images) < _FEW_VIEWS or gain < chance_gain(groups, _FALSE):
        estimate = backward(linearisation, *estimate, GATE, likelihood_of=linearisation.likelihood)
    return estimate


def _seen(sightings: Sightings) -> np.ndarray:
    observations = sightings.observations
    used = (observations.weights > 0) & np.isin(observations.image_index, sightings.images)
    return np.bincount(observations.point_index[used], minlength=len(observations.object_points)) > 0


def _close(first: Variances, second: Variances) -> bool:
    larger = np.maximum(np.maximum(first.deviation, second.deviation), _NEGLIGIBLE)
    return bool((np.abs(first.deviation - second.deviation) <= _SETTLED * larger).all())
