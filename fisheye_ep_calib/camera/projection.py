"""Projection of points through lens and pupil, with every derivative, on separate coordinate arrays.

    θ = atan2(ρ, z + E(θ)), ρ = hypot(x, y)          incidence angle (incidence.py)
    m = r(θ) (cosφ, sinφ), φ = atan2(y, x)           normalised image plane
    m ← extra(m) for every lens extra
    u = fx m_x + skew m_y + cx,  v = fy m_y + cy      pixels

Derivatives of θ at a regular root, with slope = D + E′ sinθ:
    ∂θ/∂ρ = cosθ / slope,  ∂θ/∂z = −sinθ / slope,  ∂θ/∂e_i = −sinθ basis_i(θ) / slope.

With A = ∂(u, v)/∂m, the extras' and the pixel grid's, a point that moves outwards in the image plane moves by
a = A (cosφ, sinφ) in the image, one that moves around the centre by t = A (−sinφ, cosφ):
    ∂(u, v)/∂x = cosφ r′ ∂θ/∂ρ a − sinφ r/ρ t,  ∂(u, v)/∂y = sinφ r′ ∂θ/∂ρ a + cosφ r/ρ t,  ∂(u, v)/∂z = r′ ∂θ/∂z a,
    ∂(u, v)/∂k_i = ∂r/∂k_i a,  ∂(u, v)/∂e_i = r′ ∂θ/∂e_i a.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Any, Protocol

import numpy as np

from fisheye_ep_calib.camera.extras import KNOWN_EXTRAS
from fisheye_ep_calib.camera.extras.extra import PlaneJacobian
from fisheye_ep_calib.camera.incidence import IncidenceAngle, solve_incidence_angle
from fisheye_ep_calib.camera.lenses import Lens
from fisheye_ep_calib.camera.parameters import ParameterLayout
from fisheye_ep_calib.camera.pupils import PupilFamily

_ON_AXIS = 1e-14  # ρ below this fraction of the slope counts as on the axis, where φ is undefined


def not_computed() -> np.ndarray:
    """Stands for an array that was not asked for."""
    return np.empty(0)


class ProjectingCamera(Protocol):
    """What projection needs of a camera (fisheye.py)."""

    @property
    def fx(self) -> float: ...
    @property
    def fy(self) -> float: ...
    @property
    def skew(self) -> float: ...
    @property
    def cx(self) -> float: ...
    @property
    def cy(self) -> float: ...
    @property
    def lens_model(self) -> Lens: ...
    @property
    def radial_array(self) -> np.ndarray: ...
    @property
    def pupil_family(self) -> PupilFamily: ...
    @property
    def coefficients_array(self) -> np.ndarray: ...
    @property
    def active_extras(self) -> tuple[tuple[str, tuple[float, ...]], ...]: ...
    @property
    def layout(self) -> ParameterLayout: ...


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
    camera: ProjectingCamera,
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
    if on_axis.any():
        safe_rho = np.where(on_axis, 1.0, rho)
        cos_phi, sin_phi = np.where(on_axis, 1.0, x / safe_rho), np.where(on_axis, 0.0, y / safe_rho)
    else:
        safe_rho, cos_phi, sin_phi = rho, x / rho, y / rho
    radius = camera.lens_model.radius(incidence.theta, camera.radial_array)
    stages = [(radius * cos_phi, radius * sin_phi)]  # plane points before each extra, and after the last
    for name, coefficients in camera.active_extras:
        stages.append(KNOWN_EXTRAS[name].apply(*stages[-1], coefficients))
    plane_x, plane_y = stages[-1]
    u = camera.fx * plane_x + camera.cx
    if camera.skew != 0.0:
        u += camera.skew * plane_y
    v = camera.fy * plane_y + camera.cy
    if not jacobian:
        return Projection(u, v, incidence.theta, incidence.valid)

    d_parameters = np.empty((2, len(camera.layout.names), *np.shape(rho)))
    _fill_pixel_columns(d_parameters, plane_x, plane_y)
    plane = _fill_extra_columns(camera, d_parameters, stages)
    outwards = _mapped(plane, cos_phi, sin_phi)
    around = _mapped(plane, -sin_phi, cos_phi)
    radius_slope = camera.lens_model.radius_derivative(incidence.theta, camera.radial_array)
    # Where there is no slope there is no projection.
    radius_slope = radius_slope / np.where(incidence.slope > 0, incidence.slope, np.inf)
    along_rho, along_z = radius_slope * incidence.cosine, -radius_slope * incidence.sine
    across = np.where(on_axis, along_rho, radius / safe_rho)
    _fill_radial_columns(camera, d_parameters, incidence, along_z, outwards)
    weights = (
        (cos_phi * along_rho, -sin_phi * across),
        (sin_phi * along_rho, cos_phi * across),
    )
    d_point = np.empty((2, 3, *np.shape(rho)))
    for row in range(2):
        for column, (by_rho, by_phi) in enumerate(weights):
            np.multiply(by_rho, outwards[row], out=d_point[row, column, ...])
            d_point[row, column] += by_phi * around[row]
        np.multiply(along_z, outwards[row], out=d_point[row, 2, ...])
    return Projection(u, v, incidence.theta, incidence.valid, d_point, d_parameters)


def _mapped(plane: PlaneJacobian, x: np.ndarray | float, y: np.ndarray | float) -> tuple[Any, Any]:
    """A (x, y): two arrays of the shape of x and y, or two numbers."""
    return plane.xx * x + plane.xy * y, plane.yx * x + plane.yy * y


def _fill_pixel_columns(d_parameters: np.ndarray, plane_x: np.ndarray, plane_y: np.ndarray) -> None:
    """∂(u, v)/∂(fx, fy, skew, cx, cy) into d_parameters (2, P, *S)."""
    d_parameters[:, :5] = 0.0
    d_parameters[0, 0] = plane_x
    d_parameters[1, 1] = plane_y
    d_parameters[0, 2] = plane_y
    d_parameters[0, 3] = 1.0
    d_parameters[1, 4] = 1.0


def _fill_extra_columns(
    camera: ProjectingCamera, d_parameters: np.ndarray, stages: Sequence[tuple[np.ndarray, np.ndarray]]
) -> PlaneJacobian:
    """The extras' columns of d_parameters (2, P, *S); A = ∂(u, v)/∂m. stages: plane points before every extra."""
    plane = PlaneJacobian(camera.fx, camera.skew, 0.0, camera.fy)
    for (name, coefficients), before in zip(reversed(camera.active_extras), reversed(stages[:-1]), strict=True):
        plane_x, plane_y = before
        own, d_extra = KNOWN_EXTRAS[name].jacobian(plane_x, plane_y, coefficients)
        columns = camera.layout.slices[name]
        d_parameters[0, columns], d_parameters[1, columns] = _mapped(plane, d_extra[0], d_extra[1])
        xx, yx = _mapped(plane, own.xx, own.yx)
        xy, yy = _mapped(plane, own.xy, own.yy)
        plane = PlaneJacobian(xx, xy, yx, yy)
    return plane


def _fill_radial_columns(
    camera: ProjectingCamera,
    d_parameters: np.ndarray,
    incidence: IncidenceAngle,
    along_z: np.ndarray,
    outwards: Sequence[np.ndarray],
) -> None:
    """The columns of lens and pupil, which move a point outwards only, into d_parameters (2, P, *S)."""
    blocks = [("radial", camera.lens_model.radius_jacobian(incidence.theta, camera.radial_array))]
    terms = len(camera.coefficients_array)
    if terms:
        basis = camera.pupil_family.basis(incidence.theta, terms)
        basis *= along_z
        blocks.append(("coefficients", basis))
    for name, d_radius in blocks:
        columns = camera.layout.slices[name]
        for row in range(2):
            np.multiply(d_radius, outwards[row], out=d_parameters[row, columns])
