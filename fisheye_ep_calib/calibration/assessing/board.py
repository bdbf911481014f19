"""The target's shape as a fit found it."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from fisheye_ep_calib.calibration.assessing.view_changes import BOARD_FLEXES, view_changes
from fisheye_ep_calib.calibration.estimating.fit import Fit
from fisheye_ep_calib.calibration.estimating.joint_posterior import LENS_GROUPS
from fisheye_ep_calib.calibration.estimating.joint_variances import joint_variances
from fisheye_ep_calib.calibration.estimating.shape_estimate import GATE, linearised
from fisheye_ep_calib.calibration.estimating.view_effects import FLEX, IN_PLANE
from fisheye_ep_calib.target.shape.basis import HEIGHT_GROUPS
from fisheye_ep_calib.target.shape.measured import BoardShape
from fisheye_ep_calib.target.shape.model import AXIS_GROUP, FLAT, FREE, GROUPS, REVIVED_DEVIATION, ROUGH_GROUPS
from fisheye_ep_calib.target.shape.variances import backward, gains, most_likely

_ROUGH = [GROUPS.index(name) for name in ROUGH_GROUPS]
_HEIGHTS = [GROUPS.index(name) for name in HEIGHT_GROUPS]


def board_shape(fit: Fit) -> BoardShape:
    """By how much the target departs from its file, with standard deviations and the verdict on its bend."""
    model, state = fit.problem.shape, fit.state.shape
    local, given = model.local(state), fit.sightings.observations.board
    if model.kind == FLAT or not model.size:  # what was free may have vanished
        return given or BoardShape.flat(model.nominal)
    if model.kind != FREE:
        return BoardShape(model.kind, model.nominal, local[:, :3], bent=bool(np.any(local)), slopes=local[:, 3:])
    assert model.variances is not None
    deviation, linearisation = model.variances.deviation, linearised(fit)
    weights = BoardShape(FREE, model.nominal, local[:, :3]).aspect_weights
    noise = fit.sigma_px * np.sqrt(fit.clustering)
    return BoardShape(
        FREE,
        model.nominal,
        local[:, :3],
        sigma=noise * np.sqrt(linearisation.shift_variance(model.variances)),
        bent=_is_bent(fit),
        scatter=tuple(deviation[AXIS_GROUP].tolist()),
        groups={name: float(value) for name, value in zip(GROUPS, deviation, strict=True) if value > 0},
        slopes=local[:, 3:],
        discs=fit.sightings.observations.disc_radius is not None,
        aspect_sigma_percent=100 * noise * float(np.sqrt(linearisation.sum_variance(model.variances, weights))),
    )


def _is_bent(fit: Fit) -> bool:
    """Whether a smooth height is left once every smooth group is left out that gains too little.

    What single points are off by has a smooth part too: it stays, or the smooth heights would take its place.
    """
    variances = fit.problem.shape.variances
    assert variances is not None
    if not variances.deviation[_HEIGHTS].any():
        return False
    linearisation = linearised(fit)
    deviation = variances.deviation.copy()
    deviation[_ROUGH] = np.maximum(deviation[_ROUGH], REVIVED_DEVIATION)
    estimate = most_likely(linearisation, replace(variances, deviation=deviation), from_nothing=False)
    kept, _ = backward(linearisation, *estimate, GATE, _ROUGH, linearisation.likelihood)
    return bool(kept.deviation[_HEIGHTS].any()) and _bent_beside_flex(fit)


def _bent_beside_flex(fit: Fit) -> bool:
    """Whether the views agree on a bend beside what the board does in each: the mean of that is no bend of its own."""
    try:
        found = joint_variances(fit)
        if not view_changes(found).raised(BOARD_FLEXES):
            return True
        estimate = found.most_likely((*GROUPS, *LENS_GROUPS, FLEX, IN_PLANE))  # as the error budget has it
    except np.linalg.LinAlgError:  # the views leave something open
        return True
    return bool(gains(*estimate)[_HEIGHTS].max() >= GATE)
