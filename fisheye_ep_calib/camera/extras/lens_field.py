"""A smooth field of the image plane that is not symmetric about the axis: polynomials by azimuthal order.

    w′ = w + ε Σ_pq (a_pq + i b_pq) z^p z̄^q,      w = x + i y,  z = w/(π/2)

the real and the imaginary part being x and y. A turn by α of the camera about its axis turns the term (p, q) by
α (p − q − 1), so that m = |p − q − 1| is its azimuthal order: 1 of what is decentred, 2 astigmatic, 3 and 4 of
elements held at three or four places. All terms of the orders 1 to 4 and the degrees p + q = 2 to 5; what is symmetric
is r(θ), and the degrees 0 and 1 are the pixel grid's. ε = 1/1000: coefficients are thousandths of the focal length
at 90°.

Of degree 2 and order 1 there is Brown's decentring alone, 2 c z z̄ + c̄ z². The other combination of the two terms is an
axis turned by a small δ, which the poses and the centre take up: r = θ + k1 θ³ + … turned so moves w by δ and by
(k1 + 1/6) δ̄ w² + (2 k1 − 1/6) δ w w̄. Both free, the axis and the centre drift off together.
"""

from collections.abc import Sequence

import numpy as np

from fisheye_ep_calib.camera.extras.extra import PlaneJacobian, invert_by_newton

ORDERS = (1, 2, 3, 4)
_DEGREES = range(2, 6)
_UNIT, _REACH = 1e-3, 0.5 * np.pi
_TERMS = tuple(
    (degree - q, q)
    for order in ORDERS
    for degree in _DEGREES
    for q in range(degree + 1)
    if abs(degree - 2 * q - 1) == order
)
_DECENTRING, _WITH_IT = (1, 1), (2, 0)
_FREE = tuple(term for term in _TERMS if term != _WITH_IT)


def _mixing() -> np.ndarray:
    """M (terms, coefficients), complex: a_pq + i b_pq = Σ_k M_k c_k of the real coefficients c."""
    mixing = np.zeros((len(_TERMS), 2 * len(_FREE)), complex)
    for index, term in enumerate(_FREE):
        mixing[_TERMS.index(term), 2 * index : 2 * index + 2] = (1, 1j)
    own = 2 * _FREE.index(_DECENTRING)
    mixing[_TERMS.index(_DECENTRING), own : own + 2] *= 2
    mixing[_TERMS.index(_WITH_IT), own : own + 2] = (1, -1j)
    return mixing


_MIXING = _mixing()


class LensField:
    """Elements out of round, out of line or held askew, beyond what decentring and tilt describe."""

    name = "lens_field"
    summary = "a lens that is not symmetric about its axis: a smooth field; none where it gains no more than by chance"
    coefficient_names = tuple(f"{part}{p}{q}" for p, q in _FREE for part in "ab")
    orders = tuple(abs(p - q - 1) for p, q in _FREE for _ in "ab")  # azimuthal order of each coefficient

    def apply(self, x: np.ndarray, y: np.ndarray, coefficients: Sequence[float]) -> tuple[np.ndarray, np.ndarray]:
        """The equation in the module's head."""
        powers = _powers(x, y)
        terms = zip(_MIXING @ np.asarray(coefficients), _TERMS, strict=True)
        moved = sum(c * powers[p] * np.conj(powers[q]) for c, (p, q) in terms)
        return x + _UNIT * np.real(moved), y + _UNIT * np.imag(moved)

    def jacobian(self, x: np.ndarray, y: np.ndarray, coefficients: Sequence[float]) -> tuple[PlaneJacobian, np.ndarray]:
        """∂w′/∂x = ∂w′/∂w + ∂w′/∂w̄ and ∂w′/∂y = i (∂w′/∂w − ∂w′/∂w̄), with w and w̄ taken as independent."""
        powers = _powers(x, y)
        by_own, by_conjugate = np.zeros_like(powers[0]), np.zeros_like(powers[0])
        terms = np.empty((len(_TERMS), *np.shape(powers[0])), complex)
        for index, (c, (p, q)) in enumerate(zip(_MIXING @ np.asarray(coefficients), _TERMS, strict=True)):
            if p:
                by_own += c * p * powers[p - 1] * np.conj(powers[q])
            if q:
                by_conjugate += c * q * powers[p] * np.conj(powers[q - 1])
            terms[index] = powers[p] * np.conj(powers[q])
        moved = _UNIT * np.tensordot(_MIXING.T, terms, axes=1)
        columns = np.stack([moved.real, moved.imag])
        by_x = 1 + _UNIT / _REACH * (by_own + by_conjugate)
        by_y = 1j * (1 + _UNIT / _REACH * (by_own - by_conjugate))
        return PlaneJacobian(by_x.real, by_y.real, by_x.imag, by_y.imag), columns

    def invert(
        self, x: np.ndarray, y: np.ndarray, coefficients: Sequence[float]
    ) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """By Newton steps."""
        return invert_by_newton(self, x, y, coefficients)


def _powers(x: np.ndarray, y: np.ndarray) -> list[np.ndarray]:
    """z⁰ … z⁵."""
    z = (np.asarray(x) + 1j * np.asarray(y)) / _REACH
    powers = [np.ones_like(z)]
    for _ in range(_DEGREES[-1]):
        powers.append(powers[-1] * z)
    return powers


LENS_FIELD = LensField()
