"""Gennery's pupil in the paper's sign: E(θ) = −(θ/sinθ − 1)(g0 + g1 θ² + g2 θ⁴).

Gennery, "Generalized camera calibration including fish-eye lenses", IJCV 68 (2006), section 3: he shifts the
pupil by s(θ) along the axis, E = −s.
"""

import numpy as np

from fisheye_ep_calib.camera.pupils.family import power_basis

_SERIES_BELOW = 0.05  # rad; the next series term there is below 1e-16


def _factor(theta: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """q = θ/sinθ − 1 and dq/dθ = (sinθ − θ cosθ)/sin²θ, by their series near the axis."""
    theta = np.asarray(theta, dtype=float)
    small = np.abs(theta) < _SERIES_BELOW
    safe = np.where(small, 1.0, theta)
    sine, cosine = np.sin(safe), np.cos(safe)
    square = np.where(small, theta * theta, 0.0)
    series = square * (1 / 6 + square * (7 / 360 + square * (31 / 15120 + square * (127 / 604800))))
    slope = np.where(small, theta, 0.0) * (1 / 3 + square * (7 / 90 + square * (31 / 2520 + square * (127 / 75600))))
    return (
        np.where(small, series, safe / sine - 1),
        np.where(small, slope, (sine - safe * cosine) / (sine * sine)),
    )


class GenneryPupil:
    """Even in θ; singular at θ = π."""

    default_terms = 2
    max_terms = 3

    def basis(self, theta: np.ndarray, terms: int) -> np.ndarray:
        """−(θ/sinθ − 1) θ^(2i), shape (terms, *S)."""
        factor, _ = _factor(theta)
        basis = np.empty((terms, *np.shape(theta)))
        for term in range(terms):
            basis[term] = -factor if term == 0 else basis[term - 1] * theta * theta
        return basis

    def basis_derivative(self, theta: np.ndarray, terms: int) -> np.ndarray:
        """−(q′ θ^(2i) + 2 i q θ^(2i−1)) with q = θ/sinθ − 1, shape (terms, *S)."""
        factor, slope = _factor(theta)
        basis = np.empty((terms, *np.shape(theta)))
        powers = power_basis(theta, 1, terms)  # θ^(2i−1) stands at [i − 1]
        for term in range(terms):
            if term == 0:
                basis[0] = -slope
                continue
            basis[term] = -(slope * powers[term - 1] * theta + 2 * term * factor * powers[term - 1])
        return basis


GENNERY = GenneryPupil()
