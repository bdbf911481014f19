"""The camera of a given kind that comes nearest to given pixels: least squares over all of its free parameters."""

from __future__ import annotations

import numpy as np

from fisheye_ep_calib.arrays import FloatArray
from fisheye_ep_calib.camera import FisheyeCamera
from fisheye_ep_calib.errors import InputError

_METRES = 1e-3  # a pupil's coefficient of usual size


def nearest_camera(
    start: FisheyeCamera, fixed: tuple[str, ...], points: np.ndarray, pixels: np.ndarray
) -> FisheyeCamera:
    """Minimise Σ |project(points) − pixels|² by Levenberg–Marquardt.

    start: the kind of camera, and where to begin. fixed: names of parameters that stay. points (n, 3): metres, in the
    camera frame. pixels (n, 2): where they are to be seen.
    """
    from scipy.optimize import least_squares

    free = np.array([name not in fixed for name in start.parameter_names])
    unit_of = {"px": start.fx, "m": _METRES}
    scale = np.array([unit_of.get(unit, 1.0) for unit in start.layout.units])[free]

    def trial(values: np.ndarray) -> FisheyeCamera:
        parameters = start.parameters.copy()
        parameters[free] = values * scale
        return start.with_parameters(parameters)

    def error(values: np.ndarray) -> FloatArray:
        try:
            difference: FloatArray = trial(values).project(points)[0] - pixels
        except InputError:  # a step too far, to no camera at all
            return np.full(pixels.size, 1e6)
        return difference.ravel()

    def jacobian(values: np.ndarray) -> FloatArray:
        _, _, _, d_parameters = trial(values).project_with_jacobian(points)
        scaled: FloatArray = d_parameters[..., free].reshape(-1, int(free.sum())) * scale
        return scaled

    first = start.parameters[free] / scale
    return trial(least_squares(error, first, jacobian, method="lm", xtol=1e-14, ftol=1e-14).x)
