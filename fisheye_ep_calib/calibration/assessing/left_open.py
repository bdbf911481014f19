"""Not detected is not zero: what the data leave open of a pupil that the chosen camera goes without.

All of it comes from the fullest model with a pupil beside the chosen one: E's band, the covariance, what a single
viewpoint may lose, the projection's uncertainty.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from fisheye_ep_calib.calibration.assessing.stand_in import LOSS_DISTANCES, single_viewpoint
from fisheye_ep_calib.calibration.assessing.uncertainty import Uncertainty, uncertainty
from fisheye_ep_calib.calibration.estimating.fit import Fit
from fisheye_ep_calib.camera import FisheyeCamera
from fisheye_ep_calib.camera.bands import pupil_sigma
from fisheye_ep_calib.camera.left_open import PupilLeftOpen
from fisheye_ep_calib.camera.parameters import pupil_names
from fisheye_ep_calib.errors import CalibrationError

_LARGEST = 2.0  # σ beyond the estimate: E is larger once in 40 times


@dataclass(frozen=True)
class LeftOpen:
    """camera: with the pupil left open, valid as far as its fit saw. uncertainty: of its parameters. free (P,) bool."""

    camera: FisheyeCamera
    uncertainty: Uncertainty
    free: np.ndarray

    @property
    def pupil(self) -> PupilLeftOpen:
        part = self.camera.parameter_slice("coefficients")
        return PupilLeftOpen.of(self.camera.model, self.camera.coefficients, self.uncertainty.covariance[part, part])

    def uncertainty_of(self, fit: Fit, own: Uncertainty) -> Uncertainty:
        """Of the chosen fit without a pupil; own: what it says of itself. What both have comes from the fuller one."""
        names = list(self.camera.parameter_names)
        rows = [names.index(name) for name in fit.state.camera.parameter_names if name in names]
        if len(rows) < len(own.covariance):
            return own
        return replace(
            self.uncertainty,
            covariance=self.uncertainty.covariance[np.ix_(rows, rows)],
            beside=(self.camera, self.free),
        )

    def largest_loss_px(self, distance: float) -> dict[float, float]:
        """What a single viewpoint may lose, px, by distance in metres: with a pupil that moves as far as it may."""
        try:
            return single_viewpoint(self._outermost(), distance).loss_px
        except CalibrationError:  # the camera would see hardly a point there
            return dict.fromkeys(LOSS_DISTANCES, float("nan"))

    def _outermost(self) -> FisheyeCamera:
        """The camera whose E at the rim is 2 σ larger, by the likeliest change of its terms: Cov b / √(bᵀ Cov b)."""
        rim = np.array(self.camera.theta_max)
        part = self.camera.parameter_slice("coefficients")
        covariance = self.uncertainty.covariance[part, part]
        basis = self.camera.pupil_family.basis(rim, len(self.camera.coefficients))
        sigma = float(np.sqrt(max(basis @ covariance @ basis, 1e-300)))
        sign = -1.0 if self.camera.entrance_pupil(rim) < 0 else 1.0
        moved = self.camera.coefficients_array + sign * _LARGEST * covariance @ basis / sigma
        return replace(self.camera, coefficients=tuple(moved.tolist()))


def pupil_left_open(fit: Fit, theta: float, sigma: float) -> LeftOpen | None:
    """Of the fit with a pupil that was judged; σ of E at theta (rad) is at least sigma (metres), which was claimed.

    None where the sightings leave open even that.
    """
    try:
        widened = with_pupil_sigma(uncertainty(fit), fit, theta, sigma)
    except np.linalg.LinAlgError:
        return None
    if not np.isfinite(widened.covariance).all():
        return None
    return LeftOpen(replace(fit.state.camera, theta_max=fit.largest_angle), widened, fit.problem.free)


def with_pupil_sigma(parameters: Uncertainty, fit: Fit, theta: float, sigma: float) -> Uncertainty:
    """The same with a band of E that is at least sigma wide at theta: D Cov D, D = diag(1 …, s, s …) on its terms."""
    own = float(pupil_sigma(fit.state.camera, parameters.covariance, np.array(theta)))
    if not (np.isfinite(sigma) and 0 < own < sigma):
        return parameters
    names, _ = fit.shared_parameters
    pupil = [names.index(name) for name in pupil_names(len(fit.state.camera.coefficients))]
    wider = np.ones(len(names))
    wider[pupil] = sigma / own
    shared = wider[:, None] * parameters.shared * wider
    free = np.flatnonzero(fit.problem.free)
    covariance = parameters.covariance.copy()
    covariance[np.ix_(free, free)] = shared[: len(free), : len(free)]
    return replace(parameters, covariance=covariance, shared=shared)
