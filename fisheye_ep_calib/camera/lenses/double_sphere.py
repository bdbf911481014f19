"""Double sphere (Usenko, Demmel and Cremers, 3DV 2018, equations 40–44), written as r(θ)."""

from typing import Any

import numpy as np


class DoubleSphere:
    """r = sinθ / (α d + (1 − α) (ξ + cosθ)), d = √(sin²θ + (ξ + cosθ)²), for the unit ray (sinθ, cosθ)."""

    name = "double_sphere"
    coefficient_names = ("xi", "alpha")
    start_coefficients = (-0.2, 0.6)

    @staticmethod
    def _terms(theta: np.ndarray, coefficients: np.ndarray) -> tuple[Any, ...]:
        xi, alpha = coefficients
        sine, cosine = np.sin(theta), np.cos(theta)
        shifted = xi + cosine
        distance = np.sqrt(sine * sine + shifted * shifted)
        return xi, alpha, sine, cosine, shifted, distance, alpha * distance + (1 - alpha) * shifted

    def radius(self, theta: np.ndarray, coefficients: np.ndarray) -> np.ndarray:
        """r(θ) as in the class; meaningless where the denominator is not positive (r′ is made 0 there)."""
        *_, sine, _, _, _, denominator = self._terms(theta, coefficients)
        result: np.ndarray = sine / np.where(denominator > 0, denominator, 1.0)
        return result

    def radius_derivative(self, theta: np.ndarray, coefficients: np.ndarray) -> np.ndarray:
        """dr/dθ = (cosθ q − sinθ q′)/q² with q the denominator and d′ = −ξ sinθ / d."""
        xi, alpha, sine, cosine, _, distance, denominator = self._terms(theta, coefficients)
        slope = -alpha * xi * sine / distance - (1 - alpha) * sine
        safe = np.where(denominator > 0, denominator, 1.0)
        return np.where(denominator > 0, (cosine * safe - sine * slope) / (safe * safe), 0.0)

    def radius_jacobian(self, theta: np.ndarray, coefficients: np.ndarray) -> np.ndarray:
        """∂r/∂(ξ, α) = −sinθ/q² · (α (ξ + cosθ)/d + 1 − α,  d − ξ − cosθ), shape (2, *S)."""
        _, alpha, sine, _, shifted, distance, denominator = self._terms(theta, coefficients)
        factor = -sine / (denominator * denominator)
        return np.stack([factor * (alpha * shifted / distance + 1 - alpha), factor * (distance - shifted)])


DOUBLE_SPHERE = DoubleSphere()
