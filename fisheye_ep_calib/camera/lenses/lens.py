"""The protocol of a lens and the inversion of its r(θ)."""

from typing import Protocol

import numpy as np


class Lens(Protocol):
    """An axially symmetric central projection for unit focal length: radius r of a ray at angle θ.

    name: what the camera file calls it. coefficient_names: one name a coefficient; names that lenses share mean the
    same.
    start_coefficients: where a calibration starts.
    Angles are arrays of any shape S, in radians; r is dimensionless.
    """

    @property
    def name(self) -> str: ...

    @property
    def coefficient_names(self) -> tuple[str, ...]: ...

    @property
    def start_coefficients(self) -> tuple[float, ...]: ...

    def radius(self, theta: np.ndarray, coefficients: np.ndarray) -> np.ndarray:
        """r(θ), shape S."""
        ...

    def radius_derivative(self, theta: np.ndarray, coefficients: np.ndarray) -> np.ndarray:
        """dr/dθ, shape S."""
        ...

    def radius_jacobian(self, theta: np.ndarray, coefficients: np.ndarray) -> np.ndarray:
        """∂r/∂coefficients, shape (n, *S)."""
        ...


def increasing_limit(lens: Lens, coefficients: np.ndarray, theta_max: float) -> float:
    """Largest angle up to theta_max (rad) below which r(θ) increases: a projection exists only there."""
    theta = np.linspace(0.0, theta_max, 721)
    falling = np.flatnonzero(~(lens.radius_derivative(theta, coefficients) > 0))
    if len(falling) == 0:
        return float(theta_max)
    if falling[0] == 0:
        return 0.0
    low, high = theta[falling[0] - 1], theta[falling[0]]
    for _ in range(60):
        middle = 0.5 * (low + high)
        rising = lens.radius_derivative(np.array(middle), coefficients) > 0
        low, high = (middle, high) if rising else (low, middle)
    return float(low)


def solve_angle(
    lens: Lens, radius: np.ndarray, coefficients: np.ndarray, theta_limit: float
) -> tuple[np.ndarray, np.ndarray]:
    """Invert r(θ) = radius on [0, theta_limit], where r increases, by Newton steps kept in a bracket.

    radius: any shape, ≥ 0. Returns (θ in radians, valid); θ is theta_limit where the radius lies beyond it.
    """
    radius = np.asarray(radius, dtype=float)
    largest = lens.radius(np.array(theta_limit), coefficients)
    valid = radius <= largest * (1 + 1e-12)
    low = np.zeros_like(radius)
    high = np.full_like(radius, theta_limit)
    theta = np.minimum(radius, 0.999 * theta_limit)
    for _ in range(60):
        error = lens.radius(theta, coefficients) - radius
        high = np.where(error > 0, theta, high)
        low = np.where(error <= 0, theta, low)
        slope = lens.radius_derivative(theta, coefficients)
        step = error / np.where(slope > 0, slope, 1.0)
        updated = theta - step
        inside = (slope > 0) & (updated >= low) & (updated <= high)
        updated = np.where(inside, updated, 0.5 * (low + high))
        change = np.abs(updated - theta)
        theta = updated
        if not (change[valid] > 4e-16 * (1 + theta[valid])).any():
            break
    return np.where(valid, theta, theta_limit), valid
