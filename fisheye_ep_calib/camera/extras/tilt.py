"""A sensor tilted by (τx, τy) against the lens: the homography of OpenCV's tilted sensor model.

With R = R_y(τy) R_x(τx): x′ = (R33 q_x − R13 q_z)/q_z and y′ = (R33 q_y − R23 q_z)/q_z for q = R (x, y, 1)
(OpenCV, calib3d, "tilted image sensor"; Scheimpflug).
"""

from collections.abc import Sequence

import numpy as np

from fisheye_ep_calib.camera.extras.extra import PlaneJacobian


def _homography(tilt_x: float, tilt_y: float) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """H (3, 3) and its derivatives by τx and τy, radians."""
    cos_x, sin_x, cos_y, sin_y = np.cos(tilt_x), np.sin(tilt_x), np.cos(tilt_y), np.sin(tilt_y)
    about_x = np.array([[1, 0, 0], [0, cos_x, sin_x], [0, -sin_x, cos_x]])
    about_y = np.array([[cos_y, 0, -sin_y], [0, 1, 0], [sin_y, 0, cos_y]])
    about_x_slope = np.array([[0, 0, 0], [0, -sin_x, cos_x], [0, -cos_x, -sin_x]])
    about_y_slope = np.array([[-sin_y, 0, -cos_y], [0, 0, 0], [cos_y, 0, -sin_y]])

    def projector(rotation: np.ndarray) -> np.ndarray:
        return np.array([[rotation[2, 2], 0, -rotation[0, 2]], [0, rotation[2, 2], -rotation[1, 2]], [0, 0, 1.0]])

    def projector_slope(slope: np.ndarray) -> np.ndarray:
        return np.array([[slope[2, 2], 0, -slope[0, 2]], [0, slope[2, 2], -slope[1, 2]], [0, 0, 0.0]])

    rotation = about_y @ about_x
    value = projector(rotation) @ rotation
    slopes = [
        projector_slope(slope) @ rotation + projector(rotation) @ slope
        for slope in (about_y @ about_x_slope, about_y_slope @ about_x)
    ]
    return value, slopes[0], slopes[1]


class Tilt:
    """The sensor's plane is not perpendicular to the optical axis."""

    name = "tilt"
    summary = "a sensor that is not perpendicular to the axis: tau_x, tau_y"
    coefficient_names = ("tau_x", "tau_y")

    @staticmethod
    def _map(homography: np.ndarray, x: np.ndarray, y: np.ndarray) -> tuple[np.ndarray, ...]:
        return tuple(row[0] * x + row[1] * y + row[2] for row in homography)

    def apply(self, x: np.ndarray, y: np.ndarray, coefficients: Sequence[float]) -> tuple[np.ndarray, np.ndarray]:
        """Homography of (x, y, 1)."""
        homography, _, _ = _homography(*coefficients)
        a, b, c = self._map(homography, x, y)
        return a / c, b / c

    def jacobian(self, x: np.ndarray, y: np.ndarray, coefficients: Sequence[float]) -> tuple[PlaneJacobian, np.ndarray]:
        """Quotient rule on (a/c, b/c) with (a, b, c) = H (x, y, 1)."""
        homography, slope_x, slope_y = _homography(*coefficients)
        a, b, c = self._map(homography, x, y)
        u, v = a / c, b / c
        plane = PlaneJacobian(
            (homography[0, 0] - u * homography[2, 0]) / c,
            (homography[0, 1] - u * homography[2, 1]) / c,
            (homography[1, 0] - v * homography[2, 0]) / c,
            (homography[1, 1] - v * homography[2, 1]) / c,
        )
        columns = []
        for slope in (slope_x, slope_y):
            slope_a, slope_b, slope_c = self._map(slope, x, y)
            columns.append(np.stack([(slope_a - u * slope_c) / c, (slope_b - v * slope_c) / c]))
        return plane, np.stack(columns, axis=1)

    def invert(
        self, x: np.ndarray, y: np.ndarray, coefficients: Sequence[float]
    ) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """The inverse homography, on the side of its horizon where the axis is."""
        homography, _, _ = _homography(*coefficients)
        inverse = np.linalg.inv(homography)
        a, b, c = self._map(inverse, x, y)
        front = c * inverse[2, 2] > 0
        c = np.where(front, c, 1.0)
        return a / c, b / c, front


TILT = Tilt()
