"""The protocol of a pupil family: E(θ) = Σ_i coefficients_i · basis_i(θ)."""

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
    return np.tensordot(np.asarray(coefficients, dtype=float), family.basis(theta, len(coefficients)), axes=1)


def entrance_pupil_derivative(family: PupilFamily, theta: np.ndarray, coefficients: np.ndarray) -> np.ndarray:
    """dE/dθ in metres per radian, shape of θ."""
    basis = family.basis_derivative(theta, len(coefficients))
    return np.tensordot(np.asarray(coefficients, dtype=float), basis, axes=1)


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
