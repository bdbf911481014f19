"""The paper's equation as printed: the point is moved along the *target's* axis before [R | T]. Reproduction only.

    p = R P + T + E(θ) n,  n = R e_z,  θ = atan2(hypot(p_x, p_y), p_z)   (implicit)

The text and the figure of the paper move the point along the camera's axis, which is what a lens does; this form is no
camera, for where a point lands depends on how its board is turned.

With a = ∂θ/∂p = (cosθ cosφ, cosθ sinφ, −sinθ)/|p| and s = 1/(1 − E′ a·n): dp = (I + s E′ n aᵀ) (dp₀ + E dn + n b de).
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from fisheye_ep_calib.arrays import FloatArray
from fisheye_ep_calib.camera import FisheyeCamera
from fisheye_ep_calib.camera.projection import Projection, project_coordinates
from fisheye_ep_calib.camera.pupils import CENTRAL_MODEL

_STEPS = 30


def project_along_target_axis(
    camera: FisheyeCamera,
    x: np.ndarray,
    y: np.ndarray,
    z: np.ndarray,
    normal: np.ndarray,
    theta_limit: float,
    jacobian: bool = False,
) -> tuple[Projection, np.ndarray]:
    """Project points p₀ = (x, y, z) of shape (..., B, N), camera frame, metres; normal (3, B): n of each view.

    Returns the projection, d_point by p₀, and the moved offset E n (3, ..., B, N), which turns with the board.
    """
    axis = normal.reshape(3, *[1] * (np.ndim(x) - 2), -1, 1)
    start = np.stack(np.broadcast_arrays(x, y, z))
    theta = np.arctan2(np.hypot(x, y), z)
    for _ in range(_STEPS):
        moved = start + camera.entrance_pupil(theta) * axis
        updated = np.arctan2(np.hypot(moved[0], moved[1]), moved[2])
        slope = 1 - camera.entrance_pupil_derivative(theta) * _along(moved, axis)
        step = (updated - theta) / np.where(np.abs(slope) > 1e-3, slope, 1.0)
        theta = np.clip(theta + step, 0.0, np.pi)
        if np.abs(step).max(initial=0.0) < 1e-12:
            break
    shift = camera.entrance_pupil(theta)
    moved = start + shift * axis
    central = replace(camera, model=CENTRAL_MODEL, coefficients=())
    projected = project_coordinates(central, moved[0], moved[1], moved[2], theta_limit, jacobian)
    if not jacobian:
        return projected, shift * axis
    slope = camera.entrance_pupil_derivative(theta)
    stretch = 1 / (1 - slope * _along(moved, axis))
    along_axis = (projected.d_point * axis).sum(axis=1)
    angle_row = _angle_gradient(moved)
    d_point = projected.d_point + (along_axis * stretch * slope)[:, None] * angle_row
    basis = camera.pupil_family.basis(theta, len(camera.coefficients))
    d_parameters = np.concatenate([projected.d_parameters, (along_axis * stretch)[:, None] * basis], axis=1)
    return replace(projected, d_point=d_point, d_parameters=d_parameters), shift * axis


def _angle_gradient(point: np.ndarray) -> np.ndarray:
    """a = ∂θ/∂p (3, *S) of points (3, *S), rad per metre."""
    rho = np.hypot(point[0], point[1])
    square = rho * rho + point[2] * point[2]
    safe = np.where(rho > 0, rho, 1.0)
    gradient: FloatArray = np.stack([point[2] * point[0] / safe, point[2] * point[1] / safe, -rho]) / square
    return gradient


def _along(point: np.ndarray, axis: np.ndarray) -> np.ndarray:
    along: FloatArray = (_angle_gradient(point) * axis).sum(axis=0)
    return along
