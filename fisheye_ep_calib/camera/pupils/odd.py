"""The paper's pupil: E(θ) = e1 θ³ + e2 θ⁵ + e3 θ⁷ + e4 θ⁹ (Fasogbon and Aksu)."""

import numpy as np

from fisheye_ep_calib.camera.pupils.family import power_basis


class OddPupil:
    """Odd powers from θ³. A symmetric lens has an even E(θ), so this family misses the θ² near the axis."""

    default_terms = 4
    max_terms = 4

    def basis(self, theta: np.ndarray, terms: int) -> np.ndarray:
        """θ³, θ⁵, …, shape (terms, *S)."""
        return power_basis(theta, 3, terms)

    def basis_derivative(self, theta: np.ndarray, terms: int) -> np.ndarray:
        """3 θ², 5 θ⁴, …, shape (terms, *S)."""
        basis = power_basis(theta, 2, terms)
        for term in range(terms):
            basis[term] *= 3 + 2 * term
        return basis


ODD = OddPupil()
