"""The protocol of a pupil family: E(θ) = Σ_i coefficients_i · basis_i(θ)."""

import math
from dataclasses import dataclass
from typing import Protocol

import numpy as np


class PupilFamily(Protocol):
    """Basis functions of E(θ); θ in radians, any shape S. default_terms: how many a calibration uses."""

    @property
    def default_terms(self) -> int: ...

    @property
    def max_terms(self) -> int: ...

    def basis(self, theta: np.ndarray, terms: int) -> np.ndarray:
        """basis_i(θ), dimensionless, shape (terms, *S); also ∂E/∂coefficients."""
        ...

    def basis_derivative(self, theta: np.ndarray, terms: int) -> np.ndarray:
        """d basis_i / dθ, shape (terms, *S)."""
        ...


def entrance_pupil(family: PupilFamily, theta: np.ndarray, coefficients: np.ndarray) -> np.ndarray:
    """E(θ) in the unit of the coefficients (metres), shape of θ."""
    return _combined(family.basis(theta, len(coefficients)), coefficients)


def entrance_pupil_derivative(family: PupilFamily, theta: np.ndarray, coefficients: np.ndarray) -> np.ndarray:
    """dE/dθ in metres per radian, shape of θ."""
    return _combined(family.basis_derivative(theta, len(coefficients)), coefficients)


def _combined(basis: np.ndarray, coefficients: np.ndarray) -> np.ndarray:
    """Σ_i coefficients_i basis_i, of shape S for a basis (terms, *S)."""
    weighted = np.asarray(coefficients, dtype=float) @ basis.reshape(len(basis), math.prod(basis.shape[1:]))
    result: np.ndarray = weighted.reshape(basis.shape[1:])
    return result


def entrance_pupil_with_derivative(
    family: PupilFamily, theta: np.ndarray, coefficients: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """E(θ), metres, and dE/dθ, metres per radian, each of the shape of θ."""
    if type(family) is PowerPupil:  # what extends it may have a basis of its own
        return family.value_with_derivative(theta, coefficients)
    return entrance_pupil(family, theta, coefficients), entrance_pupil_derivative(family, theta, coefficients)


@dataclass(frozen=True)
class PowerPupil:
    """E(θ) = e1 θ^p + e2 θ^(p+2) + …, p = first_power (2 or 3)."""

    first_power: int
    default_terms: int
    max_terms: int

    def basis(self, theta: np.ndarray, terms: int) -> np.ndarray:
        """θ^p, θ^(p+2), …, shape (terms, *S)."""
        return power_basis(theta, self.first_power, terms)

    def basis_derivative(self, theta: np.ndarray, terms: int) -> np.ndarray:
        """p θ^(p−1), (p+2) θ^(p+1), …, shape (terms, *S)."""
        basis = power_basis(theta, self.first_power - 1, terms)
        basis *= self._powers(terms).reshape(-1, *[1] * np.ndim(theta))
        return basis

    def value_with_derivative(self, theta: np.ndarray, coefficients: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """E = θ Σ e_i θ^(p_i − 1) and dE/dθ = Σ p_i e_i θ^(p_i − 1), each of the shape of θ."""
        terms = len(coefficients)
        basis = power_basis(theta, self.first_power - 1, terms)
        value, derivative = np.stack([coefficients, self._powers(terms) * coefficients]) @ basis.reshape(terms, -1)
        return theta * value.reshape(np.shape(theta)), derivative.reshape(np.shape(theta))

    def _powers(self, terms: int) -> np.ndarray:
        return self.first_power + 2.0 * np.arange(terms)


def power_basis(theta: np.ndarray, first: int, terms: int) -> np.ndarray:
    """θ^first, θ^(first+2), …, shape (terms, *S)."""
    basis = np.empty((terms, *np.shape(theta)))
    if terms == 0:
        return basis
    square = theta * theta
    basis[0] = theta if first == 1 else square if first == 2 else theta * square
    for term in range(1, terms):
        basis[term] = basis[term - 1] * square
    return basis
