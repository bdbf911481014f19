"""The protocol of a lens extra: a map of the normalised image plane, the identity for coefficients 0."""

from collections.abc import Sequence
from typing import NamedTuple, Protocol

import numpy as np

_SOLVED = 1e-9  # of the plane's unit


class PlaneJacobian(NamedTuple):
    """∂(x′, y′)/∂(x, y), each of shape S, or a number where it is the same everywhere."""

    xx: np.ndarray | float
    xy: np.ndarray | float
    yx: np.ndarray | float
    yy: np.ndarray | float


class LensExtra(Protocol):
    """Maps (x, y) = r (cosφ, sinφ), dimensionless, arrays of any shape S."""

    @property
    def name(self) -> str: ...

    @property
    def summary(self) -> str:
        """What it is, in a few words: the help of its option."""
        ...

    @property
    def coefficient_names(self) -> tuple[str, ...]: ...

    def apply(self, x: np.ndarray, y: np.ndarray, coefficients: Sequence[float]) -> tuple[np.ndarray, np.ndarray]:
        """(x′, y′), each of shape S."""
        ...

    def jacobian(self, x: np.ndarray, y: np.ndarray, coefficients: Sequence[float]) -> tuple[PlaneJacobian, np.ndarray]:
        """∂(x′, y′)/∂(x, y) and ∂(x′, y′)/∂coefficients, the latter of shape (2, n, *S)."""
        ...

    def invert(
        self, x: np.ndarray, y: np.ndarray, coefficients: Sequence[float]
    ) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """The (x, y) that the extra maps to the given (x′, y′), and whether there is one near the identity's."""
        ...


def invert_by_newton(
    extra: LensExtra,
    x: np.ndarray,
    y: np.ndarray,
    coefficients: Sequence[float],
    start: tuple[np.ndarray, np.ndarray] | None = None,
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Solve extra(a, b) = (x, y) by Newton steps from ``start``, or from (x, y): most maps are near the identity.

    a, b and whether they solve it, with the map not folded over there (its determinant positive).
    """
    a, b = (np.array(part, dtype=float) for part in (start or (x, y)))
    for _ in range(30):
        mapped_x, mapped_y = extra.apply(a, b, coefficients)
        error_x, error_y = mapped_x - x, mapped_y - y
        plane, _ = extra.jacobian(a, b, coefficients)
        determinant = plane.xx * plane.yy - plane.xy * plane.yx
        determinant = np.where(np.abs(determinant) > 1e-12, determinant, 1.0)
        step_a = (plane.yy * error_x - plane.xy * error_y) / determinant
        step_b = (plane.xx * error_y - plane.yx * error_x) / determinant
        a, b = a - step_a, b - step_b
        if not (np.abs(step_a) + np.abs(step_b) > 1e-15 * (1 + np.abs(a) + np.abs(b))).any():
            break
    mapped_x, mapped_y = extra.apply(a, b, coefficients)
    plane, _ = extra.jacobian(a, b, coefficients)
    with np.errstate(invalid="ignore"):
        solved = np.hypot(mapped_x - x, mapped_y - y) < _SOLVED * (1 + np.hypot(x, y))
        return a, b, solved & (plane.xx * plane.yy - plane.xy * plane.yx > 0)
