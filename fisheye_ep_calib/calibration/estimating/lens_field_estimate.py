"""A lens field beside a camera: variances at one linearisation, then the fit under them."""

from __future__ import annotations

from dataclasses import replace

from fisheye_ep_calib.calibration.estimating.fit import Fit, refine
from fisheye_ep_calib.calibration.estimating.joint_posterior import LENS_GROUPS
from fisheye_ep_calib.calibration.estimating.joint_variances import joint_variances
from fisheye_ep_calib.calibration.estimating.shape_estimate import with_estimated_shape
from fisheye_ep_calib.camera.extras.lens_field import LENS_FIELD
from fisheye_ep_calib.target.shape.model import GROUPS
from fisheye_ep_calib.target.shape.variances import chance_gain

_ROUNDS = 2  # the first linearisation is at a fit that knows nothing of the field
_FALSE = 0.01  # of lenses that are symmetric about their axis: how many may be given a field


def with_lens_field(fit: Fit, shape_anew: bool = False) -> Fit:
    """A fit with a lens field, its variances the most likely ones; as it is where they gain no more than by chance.

    shape_anew: whether a free shape of the target is estimated once more beside the field.
    Raises numpy.linalg.LinAlgError where the sightings leave something open.
    """
    plain = fit
    for _ in range(_ROUNDS):
        found = joint_variances(fit)
        effects = fit.problem.effects.names if fit.problem.effects else ()
        others = (*(GROUPS if fit.problem.shape_size else ()), *effects)
        variances, posterior = found.most_likely((*others, *LENS_GROUPS))
        if fit is plain:
            symmetric, without = found.most_likely(others)
            gain = without.deviance(symmetric) - posterior.deviance(variances)
            if gain < chance_gain(len(LENS_GROUPS), _FALSE):
                return plain
        extras = tuple(dict.fromkeys((*fit.structure.extras, LENS_FIELD.name)))
        structure = replace(fit.structure, extras=extras, field_prior=found.linearisation.field_prior(variances))
        fit = refine(fit, structure)
        if shape_anew and fit.problem.shape_size:
            fit = refine(with_estimated_shape(fit, structure), structure)
    return fit
