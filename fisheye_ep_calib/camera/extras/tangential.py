"""Decentering: x′ = x + 2 p1 x y + p2 (r² + 2 x²), y′ = y + p1 (r² + 2 y²) + 2 p2 x y (Brown, 1966)."""

from collections.abc import Sequence

import numpy as np

from fisheye_ep_calib.camera.extras.extra import PlaneJacobian, invert_by_newton


class Tangential:
    """The lens elements are not centred on one axis; OpenCV's p1, p2, on the fisheye's own plane."""

    name = "tangential"
    summary = "lens elements that are not on one axis: p1, p2"
    coefficient_names = ("p1", "p2")

    def apply(self, x: np.ndarray, y: np.ndarray, coefficients: Sequence[float]) -> tuple[np.ndarray, np.ndarray]:
        """The equation in the module's head."""
        p1, p2 = coefficients
        square = x * x + y * y
        product = 2 * x * y
        return (
            x + p1 * product + p2 * (square + 2 * x * x),
            y + p1 * (square + 2 * y * y) + p2 * product,
        )

    def jacobian(self, x: np.ndarray, y: np.ndarray, coefficients: Sequence[float]) -> tuple[PlaneJacobian, np.ndarray]:
        """∂x′/∂x = 1 + 2 p1 y + 6 p2 x, ∂x′/∂y = ∂y′/∂x = 2 p1 x + 2 p2 y, ∂y′/∂y = 1 + 6 p1 y + 2 p2 x."""
        p1, p2 = coefficients
        square = x * x + y * y
        product = 2 * x * y
        mixed = 2 * p1 * x + 2 * p2 * y
        plane = PlaneJacobian(1 + 2 * p1 * y + 6 * p2 * x, mixed, mixed, 1 + 6 * p1 * y + 2 * p2 * x)
        first = np.stack([product, square + 2 * x * x])
        second = np.stack([square + 2 * y * y, product])
        return plane, np.stack([first, second])

    def invert(
        self, x: np.ndarray, y: np.ndarray, coefficients: Sequence[float]
    ) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """By Newton steps."""
        return invert_by_newton(self, x, y, coefficients)


TANGENTIAL = Tangential()
