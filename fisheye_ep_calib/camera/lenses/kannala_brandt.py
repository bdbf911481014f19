"""Kannala–Brandt: r(θ) = θ + k1 θ³ + k2 θ⁵ + k3 θ⁷ + k4 θ⁹ (Kannala and Brandt, PAMI 2006, equation 6)."""

import numpy as np


class KannalaBrandt:
    """The equidistant projection with an odd polynomial, OpenCV's ``fisheye`` and ROS's ``equidistant``."""

    name = "kannala_brandt"
    coefficient_names = ("k1", "k2", "k3", "k4")
    start_coefficients = (0.0, 0.0, 0.0, 0.0)

    def radius(self, theta: np.ndarray, coefficients: np.ndarray) -> np.ndarray:
        """r = θ (1 + θ² (k1 + θ² (k2 + θ² (k3 + θ² k4))))."""
        k1, k2, k3, k4 = coefficients
        square = theta * theta
        return theta * (1 + square * (k1 + square * (k2 + square * (k3 + square * k4))))

    def radius_derivative(self, theta: np.ndarray, coefficients: np.ndarray) -> np.ndarray:
        """dr/dθ = 1 + 3 k1 θ² + 5 k2 θ⁴ + 7 k3 θ⁶ + 9 k4 θ⁸."""
        k1, k2, k3, k4 = coefficients
        square = theta * theta
        return 1 + square * (3 * k1 + square * (5 * k2 + square * (7 * k3 + square * (9 * k4))))

    def radius_jacobian(self, theta: np.ndarray, coefficients: np.ndarray) -> np.ndarray:
        """∂r/∂k = (θ³, θ⁵, θ⁷, θ⁹), shape (4, *S)."""
        square = theta * theta
        jacobian = np.empty((4, *np.shape(theta)))
        jacobian[0] = theta * square
        for power in range(1, 4):
            jacobian[power] = jacobian[power - 1] * square
        return jacobian


KANNALA_BRANDT = KannalaBrandt()
