"""What data leave open of an entrance pupil that a single-viewpoint camera goes without: not detected is not zero."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from fisheye_ep_calib.camera.pupils import PUPIL_FAMILIES, entrance_pupil
from fisheye_ep_calib.errors import InputError
from fisheye_ep_calib.plain_text import shown


@dataclass(frozen=True)
class PupilLeftOpen:
    """model: a key of PUPIL_FAMILIES. coefficients (n,): of its E(θ), metres. covariance (n, n): theirs, m²."""

    model: str
    coefficients: tuple[float, ...]
    covariance: tuple[tuple[float, ...], ...]

    @staticmethod
    def of(model: str, coefficients: ArrayLike, covariance: ArrayLike) -> PupilLeftOpen:
        """Checked. Raises InputError."""
        values, spread = np.array(coefficients, dtype=float), np.array(covariance, dtype=float)
        if model not in PUPIL_FAMILIES or not 0 < len(values) <= PUPIL_FAMILIES[model].max_terms:
            raise InputError(f"pupil_left_open: {shown(model)} has no such coefficients")
        if spread.shape != (len(values),) * 2 or not (np.isfinite(values).all() and np.isfinite(spread).all()):
            raise InputError("pupil_left_open: coefficients and covariance must be finite and fit each other")
        return PupilLeftOpen(model, tuple(values.tolist()), tuple(map(tuple, spread.tolist())))

    def entrance_pupil(self, theta: ArrayLike) -> np.ndarray:
        """E(θ), metres, shape of θ (rad)."""
        angles = np.asarray(theta, dtype=float)
        return entrance_pupil(PUPIL_FAMILIES[self.model], angles, np.array(self.coefficients))

    def sigma(self, theta: ArrayLike) -> np.ndarray:
        """Standard deviation of E(θ), metres, shape of θ: √(bᵀ Cov b) with b the family's basis."""
        basis = PUPIL_FAMILIES[self.model].basis(np.asarray(theta, dtype=float), len(self.coefficients))
        variance = np.einsum("i...,ij,j...->...", basis, np.array(self.covariance), basis)
        result: np.ndarray = np.sqrt(np.maximum(variance, 0.0))
        return result
