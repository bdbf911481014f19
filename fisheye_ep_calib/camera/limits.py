"""Numbers that no camera has: a file that holds them would overflow what is calculated with it."""

from __future__ import annotations

import numpy as np

from fisheye_ep_calib.camera.fisheye import FisheyeCamera
from fisheye_ep_calib.errors import InputError

_LARGEST = 1e7  # of every parameter: pixels, metres, or a lens's coefficient
_LEAST_FOCAL = 1e-2  # pixels


def refuse_absurd(camera: FisheyeCamera) -> None:
    """Raises InputError that names the first parameter of a camera from outside which is beyond all reason."""
    for name, value in zip(camera.parameter_names, camera.parameters.tolist(), strict=True):
        if abs(value) > _LARGEST or (name in ("fx", "fy") and value < _LEAST_FOCAL):
            raise InputError(f"{name} is {value:.3g}, which no camera has")
    with np.errstate(all="ignore"):
        slope = camera.lens_model.radius_derivative(np.zeros(1), camera.radial_array)
    if not (np.isfinite(slope) & (slope > 0)).all():
        raise InputError(
            f"the image radius of {camera.lens} does not rise on the axis: no camera has such coefficients"
        )
