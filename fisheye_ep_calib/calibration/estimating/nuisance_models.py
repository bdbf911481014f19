"""What a camera would be if something else beside it were not as a fit takes it to be.

One linearisation at a fit serves all (estimating/joint_posterior.py): for each model the variances of its groups are
the most likely ones, and camera and covariance follow from them.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from fisheye_ep_calib.calibration.estimating.fit import Fit
from fisheye_ep_calib.calibration.estimating.joint_posterior import JOINT_GROUPS, LENS_GROUPS
from fisheye_ep_calib.calibration.estimating.joint_variances import JointVariances, joint_variances
from fisheye_ep_calib.calibration.estimating.view_effects import FLEX, IN_PLANE, SHUTTER
from fisheye_ep_calib.camera.parameters import pupil_names
from fisheye_ep_calib.target.shape.model import GROUPS

NUISANCES: Mapping[str, tuple[str, ...]] = {
    "shape": GROUPS,
    "shape, lens field and flex": (*GROUPS, *LENS_GROUPS, FLEX),
    "flex and in-plane change": (*GROUPS, FLEX, IN_PLANE),
    "rolling shutter": (*GROUPS, *SHUTTER),
}


@dataclass(frozen=True)
class NuisanceModel:
    """deviance: −2 log-likelihood, to be compared with that of another model of the same fit.

    pupil, sigma (A,): E at the angles asked for and its posterior standard deviation, metres; independent noise.
    noise_px: σ of one coordinate. variances: τ by group, of those that have not vanished: metres, radians for what
    turns, pixels of the lens field.
    """

    name: str
    deviance: float
    pupil: np.ndarray
    sigma: np.ndarray
    noise_px: float
    variances: Mapping[str, float]


def nuisance_models(fit: Fit, angles: np.ndarray) -> tuple[NuisanceModel, ...]:
    """The models of ``NUISANCES``, E at angles (A,) rad.

    Raises numpy.linalg.LinAlgError where the sightings leave something open.
    """
    found = joint_variances(fit)
    return tuple(_model(fit, angles, found, name, groups) for name, groups in NUISANCES.items())


def _model(fit: Fit, angles: np.ndarray, found: JointVariances, name: str, groups: Sequence[str]) -> NuisanceModel:
    variances, posterior = found.most_likely(groups)
    camera = fit.state.camera
    names = pupil_names(len(camera.coefficients))
    own = [found.linearisation.camera_names.index(each) for each in names]
    basis = camera.pupil_family.basis(np.asarray(angles, float), len(names)).reshape(len(names), -1)
    pupil = (camera.coefficients_array + posterior.change[own]) @ basis
    variance = np.einsum("ka,kl,la->a", basis, posterior.camera[np.ix_(own, own)], basis)
    return NuisanceModel(
        name,
        posterior.deviance(variances),
        pupil,
        variances.noise * np.sqrt(np.maximum(variance, 0.0)),
        variances.noise,
        {group: float(tau) for group, tau in zip(JOINT_GROUPS, variances.deviation, strict=True) if tau > 0},
    )
