"""The camera: a central lens r(θ), an entrance pupil E(θ) that moves along the axis, and a pixel grid."""

from __future__ import annotations

import operator
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from fisheye_ep_calib.camera.extras import KNOWN_EXTRAS
from fisheye_ep_calib.camera.extras.brown_conrady import BROWN_CONRADY
from fisheye_ep_calib.camera.left_open import PupilLeftOpen
from fisheye_ep_calib.camera.lenses import KNOWN_LENSES, Lens, solve_angle
from fisheye_ep_calib.camera.lenses.lens import increasing_limit
from fisheye_ep_calib.camera.parameters import PIXEL_NAMES, ParameterLayout, parameter_layout
from fisheye_ep_calib.camera.projection import project_coordinates
from fisheye_ep_calib.camera.pupils import (
    CENTRAL_MODEL,
    PUPIL_FAMILIES,
    PupilFamily,
    entrance_pupil,
    entrance_pupil_derivative,
)
from fisheye_ep_calib.errors import InputError
from fisheye_ep_calib.plain_text import shown

FAR = 1e6  # metres, in place of infinity: a pupil's shift has no effect there


def _numbers(values: ArrayLike, name: str) -> np.ndarray:
    """Raises InputError where they are no array of numbers."""
    try:
        return np.asarray(values, dtype=float)
    except (TypeError, ValueError):
        raise InputError(f"`{name}` must be numbers, in lists of one length or an array, not {shown(values)}") from None


def _coordinates(values: ArrayLike, count: int, name: str) -> np.ndarray:
    """As an array (..., count). Raises InputError where it is none."""
    array = _numbers(values, name)
    if array.shape[-1:] != (count,):
        raise InputError(f"`{name}` must have the shape (..., {count}), not {array.shape}")
    return array


def _read_only(values: ArrayLike) -> np.ndarray:
    array = np.array(values, dtype=float)
    array.flags.writeable = False
    return array


@dataclass(frozen=True)
class FisheyeCamera:
    """One camera. Frame: x right, y down, z forward along the optical axis; metres, radians, pixels.

    image_size: (width, height). fx, fy, skew, cx, cy: pixels; (0, 0) is the centre of the top-left pixel.
    radial: coefficients of the lens, r(θ). model: the pupil's family, a key of PUPIL_FAMILIES.
    coefficients: of E(θ), metres; E is added to a point's z, so the pupil sits at z = −E(θ).
    lens: a key of KNOWN_LENSES. extras: coefficients by name, for the keys of KNOWN_EXTRAS that are in use.
    theta_max: rad; beyond it nothing is known and projections are marked invalid.
    pupil_left_open: of a camera without a pupil, what its data could not tell from none; it moves no projection.
    """

    image_size: tuple[int, int]
    fx: float
    fy: float
    cx: float
    cy: float
    skew: float = 0.0
    radial: tuple[float, ...] = (0.0, 0.0, 0.0, 0.0)
    model: str = CENTRAL_MODEL
    coefficients: tuple[float, ...] = ()
    extras: Mapping[str, tuple[float, ...]] = field(default_factory=dict)
    lens: str = "kannala_brandt"
    theta_max: float = np.pi
    pupil_left_open: PupilLeftOpen | None = field(default=None, compare=False)

    def __post_init__(self) -> None:
        if self.model not in tuple(PUPIL_FAMILIES):
            raise InputError(f"unknown model {shown(self.model)}; known: {', '.join(PUPIL_FAMILIES)}")
        if self.lens not in tuple(KNOWN_LENSES):
            raise InputError(f"unknown lens {shown(self.lens)}; known: {', '.join(KNOWN_LENSES)}")
        try:
            self._own_values()
        except (TypeError, ValueError, AttributeError):
            raise InputError("image_size takes two whole numbers, every camera parameter a number") from None
        if min(self.image_size) < 1:
            raise InputError(f"an image of {self.image_size[0]}×{self.image_size[1]} pixels is not possible")
        if len(self.radial) != len(self.lens_model.coefficient_names):
            raise InputError(f"{self.lens} takes {len(self.lens_model.coefficient_names)} radial coefficients")
        if len(self.coefficients) > self.pupil_family.max_terms:
            raise InputError(f"{self.model} takes at most {self.pupil_family.max_terms} pupil coefficients")
        for name, values in self.extras.items():
            if name not in KNOWN_EXTRAS or len(values) != len(KNOWN_EXTRAS[name].coefficient_names):
                raise InputError(f"unknown lens extra {shown(name)} or wrong number of its coefficients")
        if not np.isfinite(self.parameters).all():
            raise InputError("camera parameters must be finite")
        if self.fx <= 0 or self.fy <= 0 or not 0 < self.theta_max <= np.pi:
            raise InputError("fx and fy must be positive and theta_max in (0, π]")

    def _own_values(self) -> None:
        """Replace what was given by plain numbers that belong to this camera alone."""
        width, height = (operator.index(side) for side in self.image_size)
        own: dict[str, Any] = {"image_size": (width, height)}
        own |= {name: float(getattr(self, name)) for name in (*PIXEL_NAMES, "theta_max")}
        own |= {name: tuple(map(float, getattr(self, name))) for name in ("radial", "coefficients")}
        own["extras"] = {name: tuple(map(float, values)) for name, values in self.extras.items()}
        for name, value in own.items():
            object.__setattr__(self, name, value)

    @property
    def pupil_family(self) -> PupilFamily:
        return PUPIL_FAMILIES[self.model]

    @property
    def lens_model(self) -> Lens:
        return KNOWN_LENSES[self.lens]

    @cached_property
    def radial_array(self) -> np.ndarray:
        return _read_only(self.radial)

    @cached_property
    def coefficients_array(self) -> np.ndarray:
        return _read_only(self.coefficients)

    @cached_property
    def active_extras(self) -> tuple[tuple[str, tuple[float, ...]], ...]:
        """(name, coefficients) of the extras in use, in the order in which they are applied."""
        return tuple((name, tuple(self.extras[name])) for name in KNOWN_EXTRAS if name in self.extras)

    @cached_property
    def layout(self) -> ParameterLayout:
        """Order, names and units of ``parameters``."""
        return parameter_layout(self.lens, tuple(name for name, _ in self.active_extras), len(self.coefficients))

    @property
    def parameter_names(self) -> tuple[str, ...]:
        """Names of ``parameters``: fx, fy, skew, cx, cy, the lens's, the extras' in use, e1, e2, …"""
        return self.layout.names

    def parameter_slice(self, block: str) -> slice:
        """Where "pixels", "radial", an extra in use or "coefficients" stand in ``parameters``."""
        return self.layout.slices[block]

    @cached_property
    def parameters(self) -> np.ndarray:
        """All parameters (P,) in the order of ``parameter_names``."""
        values = [*(getattr(self, name) for name in PIXEL_NAMES), *self.radial]
        for _, coefficients in self.active_extras:
            values += coefficients
        return _read_only([*values, *self.coefficients])

    def with_parameters(self, parameters: np.ndarray) -> FisheyeCamera:
        """The same camera with other values (P,) in the order of ``parameter_names``."""
        values = _numbers(parameters, "parameters").ravel().tolist()
        if len(values) != len(self.parameter_names):
            raise InputError(f"this camera has {len(self.parameter_names)} parameters, not {len(values)}")
        blocks = {name: tuple(values[block]) for name, block in self.layout.slices.items()}
        changes: dict[str, Any] = dict(zip(PIXEL_NAMES, blocks["pixels"], strict=True))
        changes |= {name: blocks[name] for name in ("radial", "coefficients")}
        return replace(self, **changes, extras={name: blocks[name] for name, _ in self.active_extras})

    @cached_property
    def theta_limit(self) -> float:
        """Largest angle with a projection, rad: theta_max, or where r(θ) or the image plane stops increasing."""
        limit = increasing_limit(self.lens_model, self.radial_array, self.theta_max)
        if BROWN_CONRADY.name not in self.extras:
            return limit
        reach = np.asarray(BROWN_CONRADY.reach(self.extras[BROWN_CONRADY.name]))
        return float(solve_angle(self.lens_model, reach, self.radial_array, limit)[0])

    def entrance_pupil(self, theta: ArrayLike) -> np.ndarray:
        """E(θ), metres, shape of θ (rad). The pupil sits at z = −E(θ)."""
        return entrance_pupil(self.pupil_family, _numbers(theta, "theta"), self.coefficients_array)

    def entrance_pupil_derivative(self, theta: ArrayLike) -> np.ndarray:
        """dE/dθ, metres per radian, shape of θ."""
        theta = _numbers(theta, "theta")
        return entrance_pupil_derivative(self.pupil_family, theta, self.coefficients_array)

    def radius(self, theta: ArrayLike) -> np.ndarray:
        """r(θ) for unit focal length, shape of θ (rad)."""
        return self.lens_model.radius(_numbers(theta, "theta"), self.radial_array)

    def project(self, points: ArrayLike) -> tuple[np.ndarray, np.ndarray]:
        """Pixels (..., 2) and validity (...) of points (..., 3) in the camera frame, metres.

        valid: the point is outside the caustic, its angle below theta_max, and r(θ) still increases there.
        Whether the pixel lies inside the image is not asked.
        """
        points = _coordinates(points, 3, "points")
        projected = project_coordinates(self, points[..., 0], points[..., 1], points[..., 2], self.theta_limit)
        return np.stack([projected.u, projected.v], axis=-1), projected.valid

    def project_with_jacobian(self, points: ArrayLike) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
        """``project`` with ∂pixels/∂point (..., 2, 3) and ∂pixels/∂parameters (..., 2, P)."""
        points = _coordinates(points, 3, "points")
        projected = project_coordinates(
            self, points[..., 0], points[..., 1], points[..., 2], self.theta_limit, jacobian=True
        )
        d_point = np.moveaxis(projected.d_point, (0, 1), (-2, -1))
        d_parameters = np.moveaxis(projected.d_parameters, (0, 1), (-2, -1))
        return np.stack([projected.u, projected.v], axis=-1), projected.valid, d_point, d_parameters

    def incidence_angle(self, points: ArrayLike) -> np.ndarray:
        """θ (...), rad, of points (..., 3) in the camera frame, metres."""
        points = _coordinates(points, 3, "points")
        projected = project_coordinates(self, points[..., 0], points[..., 1], points[..., 2], self.theta_limit)
        return projected.theta

    def _plane(self, pixels: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Normalised plane coordinates before the extras, of pixels (..., 2), and whether the extras reach them."""
        plane_y = (pixels[..., 1] - self.cy) / self.fy
        plane_x = (pixels[..., 0] - self.cx - self.skew * plane_y) / self.fx
        reached = np.ones(plane_x.shape, dtype=bool)
        for name, coefficients in reversed(self.active_extras):
            plane_x, plane_y, inverted = KNOWN_EXTRAS[name].invert(plane_x, plane_y, coefficients)
            reached &= inverted
        return plane_x, plane_y, reached

    def unproject(self, pixels: ArrayLike) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """One ray a pixel (..., 2): origins (..., 3) on the axis, metres, unit directions (..., 3), valid (...).

        θ = r⁻¹(‖m‖), origin (0, 0, −E(θ)), direction (sinθ cosφ, sinθ sinφ, cosθ).
        """
        plane_x, plane_y, reached = self._plane(_coordinates(pixels, 2, "pixels"))
        radius = np.hypot(plane_x, plane_y)
        theta, valid = solve_angle(self.lens_model, radius, self.radial_array, self.theta_limit)
        safe = np.where(radius > 0, radius, 1.0)
        sine = np.sin(theta)
        directions = np.stack(
            [sine * np.where(radius > 0, plane_x / safe, 1.0), sine * plane_y / safe, np.cos(theta)], axis=-1
        )
        origins = np.zeros_like(directions)
        origins[..., 2] = -self.entrance_pupil(theta)
        return origins, directions, valid & reached

    def unproject_with_jacobian(
        self, pixels: ArrayLike
    ) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
        """``unproject`` with ∂origins/∂pixels and ∂directions/∂pixels, each (..., 3, 2).

        With the plane point m = r (cosφ, sinφ): ∂θ/∂m = (cosφ, sinφ)/r′(θ), ∂φ/∂m = (−sinφ, cosφ)/r, and
        ∂m/∂pixels the inverse of the pixel grid and the extras. On the axis sinθ/r → 1/r′(0).
        """
        pixels = _coordinates(pixels, 2, "pixels")
        origins, directions, valid = self.unproject(pixels)
        plane_x, plane_y, _ = self._plane(pixels)
        radius = np.hypot(plane_x, plane_y)
        theta = np.arctan2(np.hypot(directions[..., 0], directions[..., 1]), directions[..., 2])
        slope = self.lens_model.radius_derivative(theta, self.radial_array)
        sine, cosine = np.sin(theta), np.cos(theta)
        safe = np.where(radius > 0, radius, 1.0)
        across = np.where(radius > 0, sine / safe, 1 / slope)
        cos_phi = np.where(radius > 0, plane_x / safe, 1.0)
        sin_phi = plane_y / safe
        radial_row = np.stack([cos_phi, sin_phi], axis=-1)
        tangent_row = np.stack([-sin_phi, cos_phi], axis=-1)
        d_theta = radial_row / slope[..., None]
        d_direction = np.stack(
            [
                (cosine * cos_phi)[..., None] * d_theta - (across * sin_phi)[..., None] * tangent_row,
                (cosine * sin_phi)[..., None] * d_theta + (across * cos_phi)[..., None] * tangent_row,
                -sine[..., None] * d_theta,
            ],
            axis=-2,
        )
        d_origin = np.zeros_like(d_direction)
        d_origin[..., 2, :] = -self.entrance_pupil_derivative(theta)[..., None] * d_theta
        d_plane = np.linalg.inv(self._pixel_from_plane(plane_x, plane_y))
        return origins, directions, valid, d_origin @ d_plane, d_direction @ d_plane

    def _pixel_from_plane(self, plane_x: np.ndarray, plane_y: np.ndarray) -> np.ndarray:
        """∂pixels/∂m (..., 2, 2) at plane points before the extras."""
        matrix = np.broadcast_to(np.eye(2), (*np.shape(plane_x), 2, 2))
        for name, coefficients in self.active_extras:
            plane, _ = KNOWN_EXTRAS[name].jacobian(plane_x, plane_y, coefficients)
            step = np.stack(
                [
                    np.stack(np.broadcast_arrays(plane.xx, plane.xy), -1),
                    np.stack(np.broadcast_arrays(plane.yx, plane.yy), -1),
                ],
                -2,
            )
            matrix = step @ matrix
            plane_x, plane_y = KNOWN_EXTRAS[name].apply(plane_x, plane_y, coefficients)
        return np.array([[self.fx, self.skew], [0.0, self.fy]]) @ matrix
