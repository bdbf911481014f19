"""Gennery's pupil in the paper's sign: E(θ) = −(θ/sinθ − 1)(g0 + g1 θ² + g2 θ⁴).

Gennery, "Generalized camera calibration including fish-eye lenses", IJCV 68 (2006), section 3: he shifts the
pupil by s(θ) along the axis, E = −s.
"""

import numpy as np

from fisheye_ep_calib.camera.pupils.family import power_basis

_SERIES_BELOW = 0.05  # rad; the next series term there is below 1e-16


def _excess(theta: np.ndarray, sine: np.ndarray) -> np.ndarray:
    """q = θ/sinθ − 1, by its series near the axis; of an array θ (rad, any shape S) and its sine, shape S."""
    with np.errstate(invalid="ignore", divide="ignore"):
        excess = np.asarray(theta / sine - 1)
    small = np.abs(theta) < _SERIES_BELOW
    square = theta[small] ** 2
    excess[small] = square * (1 / 6 + square * (7 / 360 + square * (31 / 15120 + square * (127 / 604800))))
    return excess


def _excess_slope(theta: np.ndarray, sine: np.ndarray) -> np.ndarray:
    """dq/dθ = (sinθ − θ cosθ)/sin²θ, by its series near the axis; shapes as in ``_excess``."""
    with np.errstate(invalid="ignore", divide="ignore"):
        slope = np.asarray((sine - theta * np.cos(theta)) / (sine * sine))
    small = np.abs(theta) < _SERIES_BELOW
    near, square = theta[small], theta[small] ** 2
    slope[small] = near * (1 / 3 + square * (7 / 90 + square * (31 / 2520 + square * (127 / 75600))))
    return slope


class GenneryPupil:
    """Even in θ; singular at θ = π."""

    default_terms = 2
    max_terms = 3

    def basis(self, theta: np.ndarray, terms: int) -> np.ndarray:
        """−(θ/sinθ − 1) θ^(2i), shape (terms, *S)."""
        theta = np.asarray(theta, dtype=float)
        basis = np.empty((terms, *theta.shape))
        square = theta * theta
        for term in range(terms):
            basis[term] = basis[term - 1] * square if term else -_excess(theta, np.sin(theta))
        return basis

    def basis_derivative(self, theta: np.ndarray, terms: int) -> np.ndarray:
        """−(q′ θ^(2i) + 2 i q θ^(2i−1)) with q = θ/sinθ − 1, shape (terms, *S)."""
        theta = np.asarray(theta, dtype=float)
        sine = np.sin(theta)
        excess, slope = _excess(theta, sine), _excess_slope(theta, sine)
        basis = np.empty((terms, *theta.shape))
        powers = power_basis(theta, 1, terms)  # θ^(2i−1) stands at [i − 1]
        for term in range(terms):
            if term == 0:
                basis[0] = -slope
                continue
            basis[term] = -(slope * powers[term - 1] * theta + 2 * term * excess * powers[term - 1])
        return basis


GENNERY = GenneryPupil()
