"""What the choice of a pupil's family leaves open: families that explain the data as well may differ by more than σ.

With χ²_i the fitted families' costs, k_i their parameters and σ² the least of their noise variances, Akaike's weights
w_i ∝ exp(−(χ²_i/σ² + 2 k_i)/2) say how far each is from being ruled out (Burnham and Anderson, Model Selection and
Multimodel Inference, 2002, 4.2). The chosen camera stays; its covariance grows by Σ w_i δ_i δ_iᵀ, δ_i the step from it
to family i. E(θ) of another family is put in the chosen one's terms by least squares over the field, in units of σ(θ).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from fisheye_ep_calib.arrays import FloatArray
from fisheye_ep_calib.calibration.assessing.uncertainty import Uncertainty
from fisheye_ep_calib.calibration.estimating.fit import Fit
from fisheye_ep_calib.camera.bands import pupil_sigma
from fisheye_ep_calib.camera.parameters import pupil_names

_SAMPLES = 60  # angles


def with_family_spread(own: Uncertainty, chosen: Fit, others: Sequence[Fit]) -> Uncertainty:
    """The chosen fit's uncertainty, widened by what other families, fitted to the same sightings, make of them."""
    theta = np.linspace(0, chosen.largest_angle, _SAMPLES + 1)[1:]
    sigma = pupil_sigma(chosen.state.camera, own.covariance, theta)
    if not (np.isfinite(sigma) & (sigma > 0)).all():
        return own
    fits = [chosen, *(fit for fit in others if fit is not chosen)]
    weights = _weights(fits, own.clustering)
    shared = own.shared.copy()
    for weight, fit in zip(weights[1:], fits[1:], strict=True):
        step = _step(chosen, fit, theta, sigma)
        shared += weight * np.outer(step, step)
    free = np.flatnonzero(chosen.problem.free)
    covariance = own.covariance.copy()
    covariance[np.ix_(free, free)] = shared[: len(free), : len(free)]
    return replace(own, covariance=covariance, shared=shared)


def _weights(fits: Sequence[Fit], clustering: float) -> np.ndarray:
    """Akaike's weights (F,)."""
    squares = np.array([2 * fit.adjustment.equations.cost for fit in fits])
    parameters = np.array([fit.structure.parameter_count for fit in fits])
    variance = (squares / [fit.degrees_of_freedom for fit in fits]).min() * clustering
    distance = squares / max(variance, 1e-300) + 2 * parameters
    weights = np.exp(-0.5 * (distance - distance.min()))
    shares: FloatArray = weights / weights.sum()
    return shares


def _step(chosen: Fit, other: Fit, theta: np.ndarray, sigma: np.ndarray) -> np.ndarray:
    """δ (S,): from the chosen fit's shared parameters to another's; E is compared at theta (n,), in units of sigma."""
    camera = chosen.state.camera
    names, values = chosen.shared_parameters
    theirs = dict(zip(*other.shared_parameters, strict=True))
    step = np.array([theirs.get(name, value) - value for name, value in zip(names, values, strict=True)])
    basis = camera.pupil_family.basis(theta, len(camera.coefficients)) / sigma
    difference = (other.state.camera.entrance_pupil(theta) - camera.entrance_pupil(theta)) / sigma
    pupil = [names.index(name) for name in pupil_names(len(camera.coefficients))]
    step[pupil] = np.linalg.lstsq(basis.T, difference, rcond=None)[0]
    return step
