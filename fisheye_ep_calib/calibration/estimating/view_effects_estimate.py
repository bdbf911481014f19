"""What differs from view to view, beside a camera: variances at one linearisation, then the fit under them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from fisheye_ep_calib.calibration.estimating.fit import Fit, refine
from fisheye_ep_calib.calibration.estimating.joint_posterior import seen_points
from fisheye_ep_calib.calibration.estimating.joint_variances import joint_variances
from fisheye_ep_calib.calibration.estimating.shape_estimate import with_estimated_shape
from fisheye_ep_calib.calibration.estimating.view_effects import VIEW_GROUPS, view_effects
from fisheye_ep_calib.target.shape.model import GROUPS

_ROUNDS = 2  # the first linearisation is at a fit that knows nothing of the effects
_NONE = 1e-9  # metres, radians: τ of a group that has vanished beside another that has not


def with_view_effects(fit: Fit, groups: Sequence[str]) -> Fit:
    """A fit with some of VIEW_GROUPS estimated in every view, and a free shape of the target anew beside them.

    Without them where the data say nothing of any.
    """
    for _ in range(_ROUNDS):
        found = joint_variances(fit)
        shape = GROUPS if fit.problem.shape_size else ()
        variances, posterior = found.most_likely((*shape, *groups))
        tau = variances.deviation[[found.index(name) for name in VIEW_GROUPS]]
        kept = [name for name, each in zip(VIEW_GROUPS, tau, strict=True) if each > 0]
        if not kept:
            return refine(fit, fit.structure, replace(fit.sightings, effects=None))
        sightings = fit.sightings
        height = sightings.observations.image_size[1]
        effects = view_effects(sightings.target, seen_points(sightings), height, kept)
        penalty = variances.noise**2 / np.maximum(tau[effects.group], _NONE) ** 2
        determined = posterior.determined(variances)[posterior.group >= len(GROUPS)].sum()
        sightings = replace(sightings, effects=effects.with_penalty(penalty, float(determined)))
        fit = refine(fit, fit.structure, sightings)
        if fit.problem.shape_size:
            fit = refine(with_estimated_shape(fit, fit.structure, sightings), fit.structure)
    return fit
