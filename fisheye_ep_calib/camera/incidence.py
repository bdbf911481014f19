"""The implicit incidence angle: θ with ρ cosθ = (z + E(θ)) sinθ, that is θ = atan2(ρ, z + E(θ)).

With D = hypot(ρ, z + E), the distance from the pupil to the point, the derivative of
g(θ) = ρ cosθ − (z + E(θ)) sinθ at a root is −(D + E′ sinθ). The root is regular while D > −E′(θ) sinθ: the
point lies outside the caustic that the moving pupil's rays envelop.
"""

from typing import NamedTuple

import numpy as np

from fisheye_ep_calib.camera.pupils import PupilFamily, entrance_pupil, entrance_pupil_derivative


class PupilRange(NamedTuple):
    """Bounds of E(θ) in metres on [0, theta_limit] (rad)."""

    lowest: float
    highest: float
    theta_limit: float


class IncidenceAngle(NamedTuple):
    """θ (rad), slope = D + E′(θ) sinθ (metres, > 0 where regular) and valid; each of shape S."""

    theta: np.ndarray
    slope: np.ndarray
    valid: np.ndarray


def pupil_range(family: PupilFamily, coefficients: np.ndarray, theta_limit: float) -> PupilRange:
    """Bound E on [0, theta_limit] by samples plus the most that E can move between two of them."""
    theta = np.linspace(0.0, theta_limit, 257)
    shift = entrance_pupil(family, theta, coefficients)
    slope = np.abs(entrance_pupil_derivative(family, theta, coefficients)).max()
    margin = 2.0 * slope * (theta[1] - theta[0])
    return PupilRange(float(shift.min() - margin), float(shift.max() + margin), float(theta_limit))


def _beyond_limit(rho, z, family, coefficients, bounds: PupilRange) -> np.ndarray:
    """Points with g(theta_limit) > 0: they have no root of the right sign below the limit."""
    shift = entrance_pupil(family, np.array(bounds.theta_limit), coefficients)
    return rho * np.cos(bounds.theta_limit) > (z + shift) * np.sin(bounds.theta_limit)


def solve_incidence_angle(
    rho: np.ndarray,
    z: np.ndarray,
    family: PupilFamily,
    coefficients: np.ndarray,
    bounds: PupilRange,
) -> IncidenceAngle:
    """Solve θ = atan2(ρ, z + E(θ)) on [0, bounds.theta_limit].

    rho, z: arrays of one shape S, metres. As lowest ≤ E ≤ highest, every root lies between
    atan2(ρ, z + highest) and atan2(ρ, z + lowest); Newton steps are kept inside that bracket, and where the
    slope has the wrong sign, inside the caustic, the bracket is halved instead. Where no root lies below
    theta_limit, θ is theta_limit and valid is False.
    """
    theta_limit = bounds.theta_limit
    if len(coefficients) == 0:
        theta = np.arctan2(rho, z)
        valid = (theta <= theta_limit) & ((rho > 0) | (z > 0))
        return IncidenceAngle(theta, np.hypot(rho, z), valid)
    low = np.minimum(np.arctan2(rho, z + bounds.highest), theta_limit)
    high = np.minimum(np.arctan2(rho, z + bounds.lowest), theta_limit)
    theta = np.arctan2(rho, z)
    np.clip(theta, low, high, out=theta)
    theta = np.arctan2(rho, z + entrance_pupil(family, theta, coefficients))
    np.clip(theta, low, high, out=theta)
    low = np.where(_beyond_limit(rho, z, family, coefficients, bounds), high, low)
    for _ in range(80):
        sine, cosine = np.sin(theta), np.cos(theta)
        axial = z + entrance_pupil(family, theta, coefficients)
        value = rho * cosine - axial * sine
        slope = rho * sine + axial * cosine + entrance_pupil_derivative(family, theta, coefficients) * sine
        positive = value > 0
        low = np.where(positive, theta, low)
        high = np.where(positive, high, theta)
        updated = theta + value / np.where(slope > 0, slope, 1.0)
        inside = (slope > 0) & (updated >= low) & (updated <= high)
        updated = np.where(inside, updated, 0.5 * (low + high))
        change = np.abs(updated - theta).max(initial=0.0)
        theta = updated
        if change < 1e-10:  # the steps converge quadratically: the next one is below rounding
            break
    sine, cosine = np.sin(theta), np.cos(theta)
    axial = z + entrance_pupil(family, theta, coefficients)
    slope = rho * sine + axial * cosine + entrance_pupil_derivative(family, theta, coefficients) * sine
    distance = np.hypot(rho, axial)
    converged = np.abs(rho * cosine - axial * sine) <= 1e-9 * distance + 1e-300
    return IncidenceAngle(theta, slope, converged & (slope > 0) & (distance > 0))
