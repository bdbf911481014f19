"""Projection of points through lens and pupil, with every derivative, on separate coordinate arrays.

    θ = atan2(ρ, z + E(θ)), ρ = hypot(x, y)          incidence angle (incidence.py)
    m = r(θ) (cosφ, sinφ), φ = atan2(y, x)           normalised image plane
    m ← extra(m) for every lens extra
    u = fx m_x + skew m_y + cx,  v = fy m_y + cy      pixels

Derivatives of θ at a regular root, with slope = D + E′ sinθ:
    ∂θ/∂ρ = cosθ / slope,  ∂θ/∂z = −sinθ / slope,  ∂θ/∂e_i = −sinθ basis_i(θ) / slope.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import TYPE_CHECKING

import numpy as np

from fisheye_ep_calib.camera.extras import LENS_EXTRAS
from fisheye_ep_calib.camera.incidence import IncidenceAngle, solve_incidence_angle

if TYPE_CHECKING:
    from fisheye_ep_calib.camera.fisheye import FisheyeCamera

_ON_AXIS = 1e-14  # ρ below this fraction of the slope counts as on the axis, where φ is undefined


def not_computed() -> np.ndarray:
    """Stands for an array that was not asked for."""
    return np.empty(0)


@dataclass(frozen=True)
class Projection:
    """Pixels of points of shape S and, where asked for, their derivatives, else empty arrays.

    u, v (S): pixels. theta (S): incidence angle, rad. valid (S): a projection exists.
    d_point (2, 3, *S): ∂(u, v)/∂(x, y, z), pixels per metre.
    d_parameters (2, P, *S): ∂(u, v)/∂camera.parameters, in the order of camera.parameter_names.
    """

    u: np.ndarray
    v: np.ndarray
    theta: np.ndarray
    valid: np.ndarray
    d_point: np.ndarray = field(default_factory=not_computed)
    d_parameters: np.ndarray = field(default_factory=not_computed)


def project_coordinates(
    camera: FisheyeCamera,
    x: np.ndarray,
    y: np.ndarray,
    z: np.ndarray,
    theta_limit: float,
    jacobian: bool = False,
) -> Projection:
    """Project points (x, y, z) in the camera frame, metres, three arrays of one shape S.

    theta_limit: rad; points at larger angles are marked invalid.
    """
    rho = np.sqrt(x * x + y * y)
    incidence = solve_incidence_angle(rho, z, camera.pupil_family, camera.coefficients_array, theta_limit)
    on_axis = rho <= _ON_AXIS * np.abs(incidence.slope)
    safe_rho = np.where(on_axis, 1.0, rho)
    cos_phi = np.where(on_axis, 1.0, x / safe_rho)
    sin_phi = np.where(on_axis, 0.0, y / safe_rho)
    radius = camera.lens_model.radius(incidence.theta, camera.radial_array)
    plane_x, plane_y = radius * cos_phi, radius * sin_phi
    stages = []
    for name, coefficients in camera.active_extras:
        stages.append((name, coefficients, plane_x, plane_y))
        plane_x, plane_y = LENS_EXTRAS[name].apply(plane_x, plane_y, coefficients)
    u = camera.fx * plane_x + camera.skew * plane_y + camera.cx
    v = camera.fy * plane_y + camera.cy
    if not jacobian:
        return Projection(u, v, incidence.theta, incidence.valid)

    slope_inverse = 1.0 / np.where(incidence.slope > 0, incidence.slope, np.inf)
    radius_slope = camera.lens_model.radius_derivative(incidence.theta, camera.radial_array) * slope_inverse
    along_rho = radius_slope * incidence.cosine
    along_z = -radius_slope * incidence.sine
    across = np.where(on_axis, along_rho, radius / safe_rho)
    mixed = cos_phi * sin_phi * (along_rho - across)
    d_point = np.empty((2, 3, *np.shape(rho)))
    d_point[0, 0] = cos_phi * cos_phi * along_rho + sin_phi * sin_phi * across
    d_point[0, 1] = mixed
    d_point[0, 2] = cos_phi * along_z
    d_point[1, 0] = mixed
    d_point[1, 1] = sin_phi * sin_phi * along_rho + cos_phi * cos_phi * across
    d_point[1, 2] = sin_phi * along_z
    d_parameters = _plane_parameter_jacobian(camera, incidence, along_z, cos_phi, sin_phi)
    for name, coefficients, stage_x, stage_y in stages:
        plane, d_extra = LENS_EXTRAS[name].jacobian(stage_x, stage_y, coefficients)
        for columns in (d_point, d_parameters):
            _apply_plane_jacobian(columns, plane)
        d_parameters[:, camera.parameter_slice(name)] = d_extra
    for columns in (d_point, d_parameters):
        columns[0] *= camera.fx
        if camera.skew != 0.0:
            columns[0] += camera.skew * columns[1]
        columns[1] *= camera.fy
    d_parameters[:, :5] = 0.0
    d_parameters[0, 0] = plane_x
    d_parameters[1, 1] = plane_y
    d_parameters[0, 2] = plane_y
    d_parameters[0, 3] = 1.0
    d_parameters[1, 4] = 1.0
    return Projection(u, v, incidence.theta, incidence.valid, d_point, d_parameters)


def _plane_parameter_jacobian(camera, incidence: IncidenceAngle, along_z, cos_phi, sin_phi) -> np.ndarray:
    """∂m/∂parameters before extras and pixels, (2, P, *S); only lens and pupil columns are filled."""
    theta = incidence.theta
    jacobian = np.empty((2, len(camera.parameter_names), *np.shape(theta)))
    lens = camera.parameter_slice("radial")
    jacobian[:, : lens.start] = 0.0
    for name, _ in camera.active_extras:
        jacobian[:, camera.parameter_slice(name)] = 0.0
    d_radius = camera.lens_model.radius_jacobian(theta, camera.radial_array)
    np.multiply(d_radius, cos_phi, out=jacobian[0, lens])
    np.multiply(d_radius, sin_phi, out=jacobian[1, lens])
    terms = len(camera.coefficients)
    if terms:
        pupil = camera.parameter_slice("coefficients")
        d_radius = camera.pupil_family.basis(theta, terms) * along_z
        np.multiply(d_radius, cos_phi, out=jacobian[0, pupil])
        np.multiply(d_radius, sin_phi, out=jacobian[1, pupil])
    return jacobian


def _apply_plane_jacobian(columns: np.ndarray, plane) -> None:
    """columns (2, n, *S) ← plane · columns."""
    first = plane.xx * columns[0] + plane.xy * columns[1]
    columns[1] = plane.yx * columns[0] + plane.yy * columns[1]
    columns[0] = first
