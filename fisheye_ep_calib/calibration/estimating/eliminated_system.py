"""A block system (shape_equations.py) once its blocks are eliminated: solution, inverse and determinant as asked for.

What is penalised of the dense unknowns alone changes the diagonal of R: the blocks need not be eliminated again.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np

Places = dict[str, tuple[bool, slice]]


@dataclass(frozen=True)
class Eliminated:
    """The rest R d = −r of a system H x = −g with D = L Lᵀ.

    places: for each kind of unknown whether it stands among the dense ones, and where. block_factor (k, b, b): L⁻¹.
    half (k, b, d): L⁻¹ G; half_gradient (k, b, 1): L⁻¹ g_e. reduced (d, d): R. right (d,): r = g_d − Gᵀ D⁻¹ g_e.
    """

    places: Places
    block_factor: np.ndarray
    half: np.ndarray
    half_gradient: np.ndarray
    reduced: np.ndarray
    right: np.ndarray

    def without_smooth(self, kept: np.ndarray) -> Eliminated:
        """With some of the smooth unknowns (S,) bool alone, as if there had never been the others."""
        if kept.all():
            return self
        place = self.places["smooth"][1]
        own = np.concatenate([np.arange(place.start), place.start + np.flatnonzero(kept)])
        own = np.concatenate([own, np.arange(place.stop, len(self.right))])
        gone = len(kept) - int(kept.sum())
        places = {
            name: (is_dense, _moved(each, place, gone) if is_dense else each)
            for name, (is_dense, each) in self.places.items()
        }
        reduced, half = self.reduced[np.ix_(own, own)], self.half[..., own]
        return Eliminated(places, self.block_factor, half, self.half_gradient, reduced, self.right[own])

    def factored(self, penalties: dict[str, np.ndarray]) -> Factored:
        """With what is added to the diagonal of the dense unknowns, by kind.

        Raises numpy.linalg.LinAlgError where something is left open.
        """
        from scipy.linalg import lapack  # half a second that a command's --help need not wait for

        reduced = self.reduced.copy()
        diagonal = np.einsum("dd->d", reduced)  # a view
        for name, (is_dense, place) in self.places.items():
            if is_dense:
                diagonal[place] += penalties[name]
        scale = 1 / np.sqrt(np.maximum(diagonal, 1e-300))
        reduced *= scale[:, None]
        reduced *= scale
        if len(reduced):
            reduced, failed = lapack.dpotrf(reduced, lower=1)
            if failed:
                raise np.linalg.LinAlgError
        return Factored(
            self.places, self.block_factor, self.half, self.half_gradient, reduced, scale, scale * self.right
        )


def _moved(place: slice, shortened: slice, gone: int) -> slice:
    """Where unknowns are once another place, or this one, has lost some."""
    if place.start >= shortened.stop and place != shortened:
        return slice(place.start - gone, place.stop - gone)
    return slice(place.start, place.stop - gone) if place == shortened else place


@dataclass(frozen=True)
class Factored:
    """A system H x = −g with D = L Lᵀ and R = L Lᵀ: what it says is worked out as far as it is asked for.

    block_factor (k, b, b): L⁻¹ of the blocks. half (k, b, d): L⁻¹ G; half_gradient (k, b, 1): L⁻¹ g_e. dense_factor
    (d, d): L of S R S, S = diag(scale) (d,). right (d,): S (g_d − Gᵀ D⁻¹ g_e).
    """

    places: Places
    block_factor: np.ndarray
    half: np.ndarray
    half_gradient: np.ndarray
    dense_factor: np.ndarray
    scale: np.ndarray
    right: np.ndarray

    @cached_property
    def log_determinant(self) -> float:
        """log |H| = log |D| + log |R|."""
        dense = np.log(np.diag(self.dense_factor)).sum() - np.log(self.scale).sum()
        return 2 * float(dense - np.log(np.einsum("kii->ki", self.block_factor)).sum())

    @cached_property
    def decrease(self) -> float:
        """gᵀ H⁻¹ g, by which twice the cost falls with the step."""
        dense, own = self._half_right, self.half_gradient.reshape(-1)
        return float(own @ own + dense @ dense)

    @cached_property
    def step(self) -> dict[str, np.ndarray]:
        """−H⁻¹ g by kind of unknown."""
        dense = -self.scale * (self._inverse_factor.T @ self._half_right)
        own = self.half_gradient + (self.half @ dense)[..., None]
        return self._by_kind(dense, -(self.block_factor.transpose(0, 2, 1) @ own).reshape(-1))

    @cached_property
    def variance(self) -> dict[str, np.ndarray]:
        """The diagonal of H⁻¹ by kind of unknown; of the blocks it is that of D⁻¹ + (D⁻¹ G) R⁻¹ (D⁻¹ G)ᵀ."""
        from scipy.linalg import blas

        inverse, transposed = self._inverse_factor, self.block_factor.transpose(0, 2, 1)
        blocks = (self.block_factor**2).sum(axis=1).reshape(-1)
        if len(inverse) and blocks.size:
            coupled = (transposed @ self.half).reshape(len(blocks), -1)
            # Half of what a full product costs.
            spread = blas.dtrmm(1.0, inverse * self.scale, coupled.T, lower=1, overwrite_b=1).T
            blocks = blocks + np.einsum("kd,kd->k", spread, spread)
        return self._by_kind((inverse**2).sum(axis=0) * self.scale**2, blocks)

    @cached_property
    def camera(self) -> np.ndarray:
        """The camera's block (P, P) of H⁻¹."""
        place = self.places["camera"][1]
        own = self._inverse_factor[:, place] * self.scale[place]
        return np.asarray(own.T @ own)

    @cached_property
    def _half_right(self) -> np.ndarray:
        """L⁻¹ S (g_d − Gᵀ D⁻¹ g_e), (d,)."""
        from scipy.linalg import lapack

        return np.asarray(lapack.dtrtrs(self.dense_factor, self.right, lower=1)[0] if len(self.right) else self.right)

    @cached_property
    def _inverse_factor(self) -> np.ndarray:
        """L⁻¹ of the dense part, (d, d)."""
        from scipy.linalg import lapack

        if len(self.right) == 0:
            return self.dense_factor
        return np.tril(lapack.dtrtri(self.dense_factor, lower=1)[0])

    def _by_kind(self, dense: np.ndarray, blocks: np.ndarray) -> dict[str, np.ndarray]:
        return {name: dense[place] if is_dense else blocks for name, (is_dense, place) in self.places.items()}
