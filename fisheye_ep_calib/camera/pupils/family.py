"""The protocol of a pupil family: E(θ) = Σ_i coefficients_i · basis_i(θ)."""

import math
from typing import Protocol

import numpy as np


class PupilFamily(Protocol):
    """Basis functions of E(θ); θ in radians, any shape S. default_terms: how many a calibration uses."""

    default_terms: int
    max_terms: int

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
    return weighted.reshape(basis.shape[1:])


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
