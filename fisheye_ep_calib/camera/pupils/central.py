"""No pupil shift: the single-viewpoint camera, E(θ) = 0."""

import numpy as np


class CentralPupil:
    """All rays meet in one point."""

    default_terms = 0
    max_terms = 0

    def basis(self, theta: np.ndarray, terms: int) -> np.ndarray:
        """No basis function, shape (0, *S)."""
        return np.empty((0, *np.shape(theta)))

    def basis_derivative(self, theta: np.ndarray, terms: int) -> np.ndarray:
        """No basis function, shape (0, *S)."""
        return np.empty((0, *np.shape(theta)))


CENTRAL = CentralPupil()
