"""How large a lens field may be, order by order, as the likeliest variances say.

The field has more coefficients than a few views tell. So those of each azimuthal order are a priori N(0, τ²) in pixels,
τ that of restricted maximum likelihood (estimating/joint_posterior.py): an order that is not there vanishes, and of the
others what the views do not tell stays near zero.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from fisheye_ep_calib.camera import FisheyeCamera
from fisheye_ep_calib.camera.extras.lens_field import LENS_FIELD


@dataclass(frozen=True)
class FieldPrior:
    """penalties: Λ (F, F), rows; ½ cᵀ Λ c, px², of the field's coefficients c."""

    penalties: tuple[tuple[float, ...], ...]

    def penalty(self, camera: FisheyeCamera) -> np.ndarray:
        """Λ (P, P) of all of a camera's parameters."""
        result = np.zeros((len(camera.parameters),) * 2)
        own = camera.parameter_slice(LENS_FIELD.name)
        result[own, own] = self.penalties
        return result
