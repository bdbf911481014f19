"""What is known beforehand of a pupil's higher terms: how fast the series of E(θ) falls off in real lenses.

E of a lens that is symmetric about its axis is even and analytic, E = e1 θ² + e2 θ⁴ + e3 θ⁶ + e4 θ⁸ + …, whatever the
number of terms that a recording tells. Over traced published lenses (simulation/published_lenses.py) e2/e1 is 0.16 to
0.2, in the mean 0.18 with e3/e1 = 0.017, and what lies beyond two terms is small beside e1, of either sign: the root
mean square of e3/e1 of the three-term curve that comes nearest is 0.02, that of e4/e1 of the four-term one 0.004, θ in
radians. So

    e3 + g e4 ~ N(0, (0.02 e1)²),     e4 ~ N(0, (0.004 e1)²)

g = the coefficient of θ⁶ in the combination of θ², θ⁴, θ⁶ nearest to θ⁸ over the angles seen: e3 + g e4 is then the
third coefficient of the nearest three-term curve, and of the two each is free of the other. Where r(θ) has six terms,
e4 is given 2.5 times as much, room for the terms that follow it; where r(θ) has fewer it would take up what they leave.
e1 itself is taken from E at the rim, which any family tells, and the mean series: two terms fitted alone lower their e1
by what they lack.

Where the data tell these terms, they decide; where they do not, the terms stay near zero and the covariance says how
much of them is open: a Gaussian prior on a model's discrepancy (Kennedy and O'Hagan, "Bayesian calibration of computer
models", J. R. Stat. Soc. B 63, 2001), its scale from other lenses.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from fisheye_ep_calib.arrays import FloatArray
from fisheye_ep_calib.camera import FisheyeCamera
from fisheye_ep_calib.camera.pupils import PUPIL_FAMILIES

MODEL = "ep_even"  # the series itself
TERMS = PUPIL_FAMILIES[MODEL].max_terms
TYPICAL = (1.0, 0.18, 0.017)  # e1, e2, e3 over e1, in the mean
SHARES = {3: 0.02, 4: 0.004}  # σ of a term over e1, θ in radians
ROOM = 2.5  # times as much for the last one
_ANGLES = 200  # at which curves are compared


@dataclass(frozen=True)
class PupilPrior:
    """scale: |e1| of a lens like this one, metres. angle: the largest seen, rad.

    known: how many terms the data tell, without a prior. room: by which the last term's σ is multiplied.
    """

    scale: float
    angle: float
    known: int
    room: float = 1.0

    @staticmethod
    def like(camera: FisheyeCamera, angle: float, known: int) -> PupilPrior:
        """Of lenses whose E at the largest angle seen is a camera's."""
        typical = PUPIL_FAMILIES[MODEL].basis(np.array(angle), len(TYPICAL)) @ TYPICAL
        return PupilPrior(float(np.abs(camera.entrance_pupil(angle)) / typical), angle, known)

    def precision(self) -> FloatArray:
        """Inverse covariance (4, 4), 1/m², of e1, e2, e3, e4."""
        rows = np.zeros((TERMS, TERMS))
        for term in range(self.known + 1, TERMS + 1):
            deviation = SHARES[term] * self.scale * (self.room if term == TERMS else 1.0)
            rows[term - 1, term - 1] = 1 / deviation
            if term < TERMS:
                rows[term - 1, term] = _last_in_fewer(self.angle) / deviation
        result: FloatArray = rows.T @ rows
        return result

    def penalty(self, camera: FisheyeCamera, variance: float) -> FloatArray:
        """Λ (P, P), px² by the units of a camera's parameters: the precision times the variance of a residual, px².

        The variance with what clustering adds to it: covariances are multiplied by that, the prior's must not be.
        """
        result = np.zeros((len(camera.parameters),) * 2)
        pupil = camera.parameter_slice("coefficients")
        result[pupil, pupil] = variance * self.precision()
        return result


def _last_in_fewer(angle: float) -> float:
    """g: the coefficient of θ⁶ in the combination of θ², θ⁴, θ⁶ that comes nearest to θ⁸ on [0, angle]."""
    theta = np.linspace(0.0, angle, _ANGLES + 1)[1:]
    basis = PUPIL_FAMILIES[MODEL].basis(theta, TERMS)
    coefficients: FloatArray = np.linalg.lstsq(basis[:-1].T, basis[-1], rcond=None)[0]
    return float(coefficients[-1])
