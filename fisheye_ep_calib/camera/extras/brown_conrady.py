"""OpenCV's distortion of a pinhole's image plane: ROS's ``plumb_bob`` (5 terms) and ``rational_polynomial`` (8).

With s = x² + y² of the undistorted plane and f = (1 + k1 s + k2 s² + k3 s³)/(1 + k4 s + k5 s² + k6 s³):

    x′ = x f + 2 p1 x y + p2 (s + 2 x²) + s1 s + s2 s²
    y′ = y f + p1 (s + 2 y²) + 2 p2 x y + s3 s + s4 s²

(OpenCV, calib3d; Brown, 1966; Weng, Cohen and Herniou, PAMI 1992.) The decentering is that of the undistorted plane:
it cannot follow a lens r(θ) that holds the radial terms, as the extra ``tangential`` would. For cameras of other
calibrators; a calibration here does not estimate it. Coefficients in OpenCV's order.
"""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from fisheye_ep_calib.camera.bracketing import last_where, rising_root
from fisheye_ep_calib.camera.extras.extra import PlaneJacobian, invert_by_newton

_WIDEST = 100.0  # of the plane; a pinhole at 89.4°
_ORDER = ("k1", "k2", "p1", "p2", "k3", "k4", "k5", "k6", "s1", "s2", "s3", "s4")


class _Radial(NamedTuple):
    """f, its derivative by s, and 1 over its denominator, at s, each of shape S."""

    factor: np.ndarray
    slope: np.ndarray
    share: np.ndarray


def _radial(square: np.ndarray, coefficients: Sequence[float]) -> _Radial:
    k1, k2, _, _, k3, k4, k5, k6 = coefficients[:8]
    with np.errstate(divide="ignore", invalid="ignore", over="ignore"):
        share = 1 / (1 + square * (k4 + square * (k5 + square * k6)))
        factor = (1 + square * (k1 + square * (k2 + square * k3))) * share
        slope = (k1 + square * (2 * k2 + square * 3 * k3)) * share
        slope = slope - factor * (k4 + square * (2 * k5 + square * 3 * k6)) * share
    return _Radial(np.asarray(factor), np.asarray(slope), np.asarray(share))


class BrownConrady:
    """Folds over where x f(x²) turns: ``reach`` tells where, and beyond it there is no image."""

    name = "brown_conrady"
    summary = "the distortion of a pinhole camera"
    coefficient_names = tuple(f"bc_{name}" for name in _ORDER)

    def apply(self, x: np.ndarray, y: np.ndarray, coefficients: Sequence[float]) -> tuple[np.ndarray, np.ndarray]:
        """The equations in the module's head."""
        _, _, p1, p2, *_, s1, s2, s3, s4 = coefficients
        square, product = x * x + y * y, 2 * x * y
        factor = _radial(square, coefficients).factor
        return (
            x * factor + p1 * product + p2 * (square + 2 * x * x) + square * (s1 + square * s2),
            y * factor + p1 * (square + 2 * y * y) + p2 * product + square * (s3 + square * s4),
        )

    def jacobian(self, x: np.ndarray, y: np.ndarray, coefficients: Sequence[float]) -> tuple[PlaneJacobian, np.ndarray]:
        """∂x′/∂x = f + 2 x² f′ + 2 p1 y + 6 p2 x + 2 x (s1 + 2 s2 s) and the like; f′ = df/ds. Columns as named."""
        _, _, p1, p2, *_, s1, s2, s3, s4 = coefficients
        square, product = x * x + y * y, 2 * x * y
        factor, slope, share = _radial(square, coefficients)
        mixed = product * slope + 2 * p1 * x + 2 * p2 * y
        prism_x, prism_y = 2 * (s1 + 2 * s2 * square), 2 * (s3 + 2 * s4 * square)
        plane = PlaneJacobian(
            factor + 2 * x * x * slope + 2 * p1 * y + 6 * p2 * x + prism_x * x,
            mixed + prism_x * y,
            mixed + prism_y * x,
            factor + 2 * y * y * slope + 6 * p1 * y + 2 * p2 * x + prism_y * y,
        )
        none = np.zeros(np.shape(square))
        powers = [square * share, square * square * share, square**3 * share]
        above = [np.stack([x * power, y * power]) for power in powers]
        below = [-factor * column for column in above]
        decentering = [np.stack([product, square + 2 * y * y]), np.stack([square + 2 * x * x, product])]
        prism = [np.stack([square, none]), np.stack([square * square, none])]
        prism += [np.stack([none, square]), np.stack([none, square * square])]
        return plane, np.stack([*above[:2], *decentering, above[2], *below, *prism], axis=1)

    def reach(self, coefficients: Sequence[float]) -> float:
        """The radius of the undistorted plane up to which x f(x²) rises: it has an image only there."""

        def rises(radius: np.ndarray) -> np.ndarray:
            square = radius * radius
            factor, slope, share = _radial(square, coefficients)
            with np.errstate(invalid="ignore"):
                return np.asarray((factor + 2 * square * slope > 0) & (share > 0) & np.isfinite(share))

        radii = np.tan(np.linspace(0.0, np.arctan(_WIDEST), 2001))
        folded = np.flatnonzero(~rises(radii))
        if len(folded) == 0:
            return _WIDEST
        return float(last_where(rises, radii[max(folded[0] - 1, 0)], radii[folded[0]]))

    def invert(
        self, x: np.ndarray, y: np.ndarray, coefficients: Sequence[float]
    ) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Newton steps from where the radial part alone has its root, which it brackets: barrels are far from 1."""
        reach = self.reach(coefficients)

        def error(radius: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
            factor, slope, _ = _radial(radius * radius, coefficients)
            return radius * factor - sought, factor + 2 * radius * radius * slope

        wanted = np.hypot(x, y)
        widest = reach * _radial(np.asarray(reach * reach), coefficients).factor
        sought = np.minimum(wanted, widest)
        zero = np.zeros_like(sought)
        radius = rising_root(error, zero, zero + reach, np.minimum(sought, 0.9 * reach), 1e-12)
        scale = np.where(wanted > 0, radius / np.where(wanted > 0, wanted, 1.0), 1.0)
        a, b, solved = invert_by_newton(self, x, y, coefficients, start=(scale * x, scale * y))
        with np.errstate(invalid="ignore"):
            return a, b, solved & (np.hypot(a, b) <= reach * (1 + 1e-9))


BROWN_CONRADY = BrownConrady()
