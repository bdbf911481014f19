"""The protocol of a lens and the inversion of its r(θ)."""

from typing import Protocol

import numpy as np

from fisheye_ep_calib.camera.bracketing import last_where, rising_root

_ROUNDING = 4e-16  # rad, of 1 + θ


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
    return float(last_where(lambda angle: lens.radius_derivative(angle, coefficients) > 0, low, high))


def solve_angle(
    lens: Lens, radius: np.ndarray, coefficients: np.ndarray, theta_limit: float
) -> tuple[np.ndarray, np.ndarray]:
    """Invert r(θ) = radius on [0, theta_limit], where r increases, by Newton steps kept in a bracket.

    radius: any shape, ≥ 0. Returns (θ in radians, valid); θ is theta_limit where the radius lies beyond it.
    """
    radius = np.asarray(radius, dtype=float)
    largest = lens.radius(np.array(theta_limit), coefficients)
    valid = radius <= largest * (1 + 1e-12)
    reached = np.minimum(radius, largest)

    def error(theta: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        return lens.radius(theta, coefficients) - reached, lens.radius_derivative(theta, coefficients)

    start = np.minimum(reached, 0.999 * theta_limit)
    low, high = np.zeros_like(reached), np.full_like(reached, theta_limit)
    theta = rising_root(error, low, high, start, _ROUNDING)
    return np.where(valid, theta, theta_limit), valid
