"""The even pupil: E(θ) = e1 θ² + e2 θ⁴ + …; axial symmetry makes the pupil shift of a real lens even in θ."""

import numpy as np

from fisheye_ep_calib.camera.pupils.family import power_basis


class EvenPupil:
    """Even powers from θ²."""

    default_terms = 2
    max_terms = 4

    def basis(self, theta: np.ndarray, terms: int) -> np.ndarray:
        """θ², θ⁴, …, shape (terms, *S)."""
        return power_basis(theta, 2, terms)

    def basis_derivative(self, theta: np.ndarray, terms: int) -> np.ndarray:
        """2 θ, 4 θ³, …, shape (terms, *S)."""
        basis = power_basis(theta, 1, terms)
        for term in range(terms):
            basis[term] *= 2 + 2 * term
        return basis


EVEN = EvenPupil()
