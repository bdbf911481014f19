"""The pinhole: r(θ) = tanθ. Cameras of other calibrators come with it; a calibration here does not estimate it."""

import numpy as np

LEAST_COSINE = 0.01  # of θ: beyond 89.4° a plane image is 100 focal lengths wide, and no sensor is


class Perspective:
    """r = tanθ, up to 89.4°. Straight lines stay straight but for what the extra ``brown_conrady`` bends."""

    name = "perspective"
    coefficient_names: tuple[str, ...] = ()
    start_coefficients: tuple[float, ...] = ()

    def radius(self, theta: np.ndarray, coefficients: np.ndarray) -> np.ndarray:
        """tanθ; meaningless beyond 89.4°, where the derivative is 0."""
        return np.asarray(np.tan(theta))

    def radius_derivative(self, theta: np.ndarray, coefficients: np.ndarray) -> np.ndarray:
        """dr/dθ = 1/cos²θ; 0 where there is no image."""
        cosine = np.cos(theta)
        in_front = cosine > LEAST_COSINE
        return np.where(in_front, 1 / np.where(in_front, cosine, 1.0) ** 2, 0.0)

    def radius_jacobian(self, theta: np.ndarray, coefficients: np.ndarray) -> np.ndarray:
        """No coefficient, shape (0, *S)."""
        return np.empty((0, *np.shape(theta)))


PERSPECTIVE = Perspective()
