"""Kannala–Brandt: r(θ) = θ + k1 θ³ + k2 θ⁵ + k3 θ⁷ + … (Kannala and Brandt, PAMI 2006, equation 6)."""

import numpy as np


class KannalaBrandt:
    """The equidistant projection with an odd polynomial; four terms are OpenCV's ``fisheye``, ROS's ``equidistant``."""

    def __init__(self, name: str, terms: int) -> None:
        self.name = name
        self.coefficient_names = tuple(f"k{term}" for term in range(1, terms + 1))
        self.start_coefficients = (0.0,) * terms

    def radius(self, theta: np.ndarray, coefficients: np.ndarray) -> np.ndarray:
        """r = θ (1 + θ² (k1 + θ² (k2 + θ² (k3 + …))))."""
        square = theta * theta
        result: np.ndarray = theta * (1 + square * _horner(square, coefficients))
        return result

    def radius_derivative(self, theta: np.ndarray, coefficients: np.ndarray) -> np.ndarray:
        """dr/dθ = 1 + 3 k1 θ² + 5 k2 θ⁴ + 7 k3 θ⁶ + …"""
        square = theta * theta
        powers = 2 * np.arange(1, len(coefficients) + 1) + 1
        result: np.ndarray = 1 + square * _horner(square, powers * coefficients)
        return result

    def radius_jacobian(self, theta: np.ndarray, coefficients: np.ndarray) -> np.ndarray:
        """∂r/∂k = (θ³, θ⁵, θ⁷, …), shape (n, *S)."""
        square = theta * theta
        jacobian = np.empty((len(coefficients), *np.shape(theta)))
        jacobian[0] = theta * square
        for term in range(1, len(coefficients)):
            jacobian[term] = jacobian[term - 1] * square
        return jacobian


def _horner(square: np.ndarray, coefficients: np.ndarray) -> np.ndarray:
    """c1 + s (c2 + s (c3 + …)) of s = square, any shape S, and coefficients (n,); shape S."""
    *others, value = coefficients
    for coefficient in reversed(others):
        value = coefficient + square * value
    return np.asarray(value)


KANNALA_BRANDT = KannalaBrandt("kannala_brandt", 4)
KANNALA_BRANDT_6 = KannalaBrandt("kannala_brandt_6", 6)  # what four terms leave may pass for a pupil's shift
