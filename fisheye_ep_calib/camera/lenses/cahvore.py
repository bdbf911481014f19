"""The lens of CAHVOR and CAHVORE: r(θ) = χ (1 + r0 + r1 χ² + r2 χ⁴), χ(θ) between a pinhole and a fisheye.

With the linearity L: χ = tan(Lθ)/L for L > 0 (a pinhole at 1, stereographic at ½), θ for 0, sin(Lθ)/L for L < 0
(orthographic at −1). Gennery, "Generalized camera calibration including fish-eye lenses", IJCV 68 (2006); mrcal's
LENSMODEL_CAHVORE. 1 + r0 is a factor of the focal length, but for a tilted axis.
"""

import numpy as np

from fisheye_ep_calib.camera.lenses.perspective import LEAST_COSINE

_SERIES_BELOW = 0.03  # of Lθ; the next series term there is below 1e-13


class Cahvore:
    """Coefficients: linearity, r0, r1, r2; dimensionless."""

    name = "cahvore"
    coefficient_names = ("linearity", "r0", "r1", "r2")
    start_coefficients = (0.5, 0.0, 0.0, 0.0)

    @staticmethod
    def _chi(theta: np.ndarray, linearity: float) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """χ, dχ/dθ and dχ/dL, each of shape S; dχ/dθ is 0 where |L| θ reaches 90°."""
        turned = np.asarray(linearity * theta)  # Lθ
        cosine = np.cos(turned)
        inside = (cosine > LEAST_COSINE) & (np.abs(turned) < np.pi / 2)
        square = turned * turned
        if linearity > 0:
            tangent = np.tan(np.where(inside, turned, 0.0))
            chi, slope = tangent / linearity, np.where(inside, 1 + tangent * tangent, 0.0)
            series = turned * (2 / 3 + square * (8 / 15 + square * 34 / 105))
        elif linearity < 0:
            chi, slope = np.sin(turned) / linearity, np.where(inside, cosine, 0.0)
            series = turned * (-1 / 3 + square * (1 / 30 - square / 840))
        else:
            return np.asarray(theta, dtype=float), np.ones(np.shape(theta)), np.zeros(np.shape(theta))
        by_linearity = np.where(
            np.abs(turned) < _SERIES_BELOW, theta * theta * series, (theta * slope - chi) / linearity
        )
        return chi, slope, by_linearity

    def radius(self, theta: np.ndarray, coefficients: np.ndarray) -> np.ndarray:
        """χ (1 + r0 + r1 χ² + r2 χ⁴)."""
        linearity, r0, r1, r2 = coefficients
        chi, _, _ = self._chi(theta, float(linearity))
        square = chi * chi
        result: np.ndarray = chi * (1 + r0 + square * (r1 + square * r2))
        return result

    def radius_derivative(self, theta: np.ndarray, coefficients: np.ndarray) -> np.ndarray:
        """dr/dθ = (1 + r0 + 3 r1 χ² + 5 r2 χ⁴) dχ/dθ; 0 where |L| θ reaches 90°."""
        linearity, r0, r1, r2 = coefficients
        chi, slope, _ = self._chi(theta, float(linearity))
        return np.asarray(_by_chi(chi, r0, r1, r2) * slope)

    def radius_jacobian(self, theta: np.ndarray, coefficients: np.ndarray) -> np.ndarray:
        """∂r/∂(L, r0, r1, r2) = ((1 + r0 + 3 r1 χ² + 5 r2 χ⁴) ∂χ/∂L, χ, χ³, χ⁵), shape (4, *S)."""
        linearity, r0, r1, r2 = coefficients
        chi, _, by_linearity = self._chi(theta, float(linearity))
        return np.stack([_by_chi(chi, r0, r1, r2) * by_linearity, chi, chi**3, chi**5])


def _by_chi(chi: np.ndarray, r0: float, r1: float, r2: float) -> np.ndarray:
    """dr/dχ = 1 + r0 + 3 r1 χ² + 5 r2 χ⁴, shape of χ."""
    square = chi * chi
    return np.asarray(1 + r0 + square * (3 * r1 + square * 5 * r2))


CAHVORE = Cahvore()
