"""The implicit incidence angle: θ with ρ cosθ = (z + E(θ)) sinθ, that is θ = atan2(ρ, z + E(θ)).

With D = hypot(ρ, z + E), the distance from the pupil to the point, the derivative of
g(θ) = ρ cosθ − (z + E(θ)) sinθ at a root is −(D + E′ sinθ). The root is regular while D > −E′(θ) sinθ: the
point lies outside the caustic that the moving pupil's rays envelop. The Newton steps solve the same root as
h(θ) = θ − atan2(ρ, z + E(θ)), h′(θ) = 1 + ρ E′ / D²: one transcendental function a step, and free of rounding near 90°.
"""

from typing import NamedTuple

import numpy as np

from fisheye_ep_calib.camera.bracketing import last_where, rising_root
from fisheye_ep_calib.camera.pupils import (
    PupilFamily,
    entrance_pupil,
    entrance_pupil_derivative,
    entrance_pupil_with_derivative,
)

_NEWTON_STEPS = 8
_LEAST_SLOPE = 1e-4  # of the distance: on the caustic, where the slope is zero, a pixel's derivatives are infinite
_SMALL_STEP = 1e-8  # rad; the steps converge quadratically, so that the next one is below rounding


class IncidenceAngle(NamedTuple):
    """θ (rad), its sine and cosine, slope = D + E′(θ) sinθ (metres, > 0 where regular) and valid; each of shape S."""

    theta: np.ndarray
    sine: np.ndarray
    cosine: np.ndarray
    slope: np.ndarray
    valid: np.ndarray


def pupil_range(family: PupilFamily, coefficients: np.ndarray, theta_limit: float) -> tuple[float, float]:
    """Bounds (metres) of E on [0, theta_limit] (rad): of samples, and the most that E can move between two of them."""
    theta = np.linspace(0.0, theta_limit, 257)
    shift = entrance_pupil(family, theta, coefficients)
    slope = np.abs(entrance_pupil_derivative(family, theta, coefficients)).max()
    margin = 2.0 * slope * (theta[1] - theta[0])
    return float(shift.min() - margin), float(shift.max() + margin)


def solve_incidence_angle(
    rho: np.ndarray,
    z: np.ndarray,
    family: PupilFamily,
    coefficients: np.ndarray,
    theta_limit: float,
) -> IncidenceAngle:
    """Solve θ = atan2(ρ, z + E(θ)) on [0, theta_limit].

    rho, z: arrays of one shape S, metres. Newton steps from the central angle settle nearly every point; those that
    they do not are solved in a bracket. Where no root lies below theta_limit, valid is False.
    """
    theta = np.arctan2(rho, z)
    if len(coefficients) == 0:
        valid = (theta <= theta_limit) & ((rho > 0) | (z > 0))
        distance = np.sqrt(rho * rho + z * z)
        safe = np.where(distance > 0, distance, 1.0)
        return IncidenceAngle(theta, rho / safe, z / safe, distance, valid)
    with np.errstate(all="ignore"):  # points that run away are caught below
        square = rho * rho
        for _ in range(_NEWTON_STEPS):
            axial, derivative = entrance_pupil_with_derivative(family, theta, coefficients)
            axial += z
            step = np.arctan2(rho, axial)
            step -= theta
            step /= 1 + rho * derivative / (square + axial * axial)
            theta = theta + step
            if np.abs(step).max(initial=0.0) < _SMALL_STEP:
                break
        axial += derivative * step  # E at the angle after the last step: exact to its square
        distance = np.sqrt(square + axial * axial)
        sine, cosine = rho / distance, axial / distance
        slope = distance + derivative * sine
        solved = (np.abs(step) < _SMALL_STEP) & (theta >= 0) & (theta <= theta_limit)
        solved &= slope > _LEAST_SLOPE * distance
    if solved.all():
        return IncidenceAngle(theta, sine, cosine, slope, solved)
    theta = np.where(solved, theta, theta_limit)
    theta[~solved] = _solve_in_bracket(rho[~solved], z[~solved], family, coefficients, theta_limit)
    value, slope, sine, cosine = _equation(theta, rho, z, family, coefficients)
    distance = np.hypot(rho, z + entrance_pupil(family, theta, coefficients))
    valid = (np.abs(value) <= 1e-9 * distance) & (slope > _LEAST_SLOPE * distance) & (distance > 0)
    return IncidenceAngle(theta, sine, cosine, slope, valid)


def _equation(
    theta: np.ndarray, rho: np.ndarray, z: np.ndarray, family: PupilFamily, coefficients: np.ndarray
) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """g(θ), −g′(θ) = ρ sinθ + (z + E) cosθ + E′ sinθ, sinθ and cosθ."""
    sine, cosine = np.sin(theta), np.cos(theta)
    shift, derivative = entrance_pupil_with_derivative(family, theta, coefficients)
    axial = z + shift
    value = rho * cosine - axial * sine
    slope = (rho + derivative) * sine + axial * cosine
    return value, slope, sine, cosine


def _solve_in_bracket(
    rho: np.ndarray, z: np.ndarray, family: PupilFamily, coefficients: np.ndarray, theta_limit: float
) -> np.ndarray:
    """θ by Newton steps kept in a bracket; theta_limit where there is no root below it.

    As lowest ≤ E ≤ highest, every root lies between atan2(ρ, z + highest) and atan2(ρ, z + lowest). Just outside the
    caustic g is positive at both ends and dips below zero between them: the bracket then ends where g turns. Where
    the slope has the wrong sign, inside the caustic, the bracket is halved instead.
    """
    lowest, highest = pupil_range(family, coefficients, theta_limit)
    low = np.minimum(np.arctan2(rho, z + highest), theta_limit)
    high = np.minimum(np.arctan2(rho, z + lowest), theta_limit)
    value, slope, _, _ = _equation(high, rho, z, family, coefficients)
    rising = (value > 0) & (slope < 0)
    if rising.any():
        high[rising] = _turning_angle(rho[rising], z[rising], low[rising], high[rising], family, coefficients)
        value, _, _, _ = _equation(high, rho, z, family, coefficients)
    low = np.where((value > 0) & (rising | (high >= theta_limit)), high, low)

    def equation(theta: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        value, slope, _, _ = _equation(theta, rho, z, family, coefficients)
        return -value, slope

    return rising_root(equation, low, high, 0.5 * (low + high), _SMALL_STEP)


def _turning_angle(
    rho: np.ndarray, z: np.ndarray, low: np.ndarray, high: np.ndarray, family: PupilFamily, coefficients: np.ndarray
) -> np.ndarray:
    """The angle (n,) at which g stops falling, between low, where it falls, and high, where it rises."""
    return last_where(lambda theta: _equation(theta, rho, z, family, coefficients)[1] > 0, low, high)
