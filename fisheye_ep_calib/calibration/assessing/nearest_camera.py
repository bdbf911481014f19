"""The camera of a given kind that comes nearest to given pixels: least squares over all of its free parameters."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from fisheye_ep_calib.arrays import FloatArray
from fisheye_ep_calib.camera import FisheyeCamera
from fisheye_ep_calib.errors import InputError

_FIRST_DAMPING, _LEAST_DAMPING, _MOST_DAMPING = 1e-3, 1e-12, 1e12
_MOST_STEPS = 200
_SETTLED = 1e-14  # of the largest value, in what it does to the pixels
_METRES = 1e-3  # a pupil's coefficient of usual size


def nearest_camera(
    start: FisheyeCamera, fixed: tuple[str, ...], points: np.ndarray, pixels: np.ndarray
) -> FisheyeCamera:
    """Minimise Σ |project(points) − pixels|² by Levenberg–Marquardt.

    start: the kind of camera, and where to begin. fixed: names of parameters that stay. points (n, 3): metres, in the
    camera frame. pixels (n, 2): where they are to be seen.
    """
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
    return trial(_least_squares(error, jacobian, first))


def _least_squares(
    error: Callable[[np.ndarray], FloatArray], jacobian: Callable[[np.ndarray], FloatArray], values: np.ndarray
) -> FloatArray:
    """Minimise |error(x)|² over x (n,) by Levenberg's and Marquardt's steps (Moré 1978), from values on.

    A step δ solves min |J δ + r|² + λ |D δ|², D² = diag JᵀJ. To load scipy.optimize takes ten times as long as this.
    """
    residual, damping = error(values), _FIRST_DAMPING
    for _ in range(_MOST_STEPS):
        columns = jacobian(values)
        scale = np.maximum(np.linalg.norm(columns, axis=0), 1e-300)
        while damping < _MOST_DAMPING:
            rows = np.concatenate([columns / scale, np.sqrt(damping) * np.eye(len(values))])
            step = np.linalg.lstsq(rows, np.concatenate([-residual, np.zeros(len(values))]), rcond=None)[0] / scale
            moved = error(values + step)
            if moved @ moved <= residual @ residual:
                break
            damping *= 10
        else:
            return values
        values, residual, damping = values + step, moved, max(damping / 10, _LEAST_DAMPING)
        if np.abs(step * scale).max() <= _SETTLED * np.abs(values * scale).max():
            break
    return values
