"""A camera behind a ray-traced lens: projects, unprojects and can be rendered through like any other camera."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import ArrayLike
from scipy.interpolate import CubicSpline

from fisheye_ep_calib.arrays import FloatArray
from fisheye_ep_calib.simulation.prescription import Prescription
from fisheye_ep_calib.simulation.published_lenses import PUBLISHED_LENSES, published_lens
from fisheye_ep_calib.simulation.ray_traced_lens import chief_rays, laikin_170

_RAYS = 4000
_STEEPEST_STOP_ANGLE = np.radians(60)
_ITERATIONS = 60
_RIM = 1000.0  # px, of the image radius where a lens's field ends


@dataclass(frozen=True)
class RayTracedCamera:
    """A lens and a sensor. Camera frame: origin in the paraxial entrance pupil, x right, y down, z to the scene.

    pixel_pitch: metres. cx, cy: pixels. theta_max: rad; the lens itself may end before it.

    θ, s and r of a few thousand traced rays are joined by cubic splines, which here err by less than a nanometre.
    """

    lens: Prescription
    image_size: tuple[int, int]
    pixel_pitch: float
    cx: float
    cy: float
    theta_max: float = np.radians(100)

    @cached_property
    def _curves(self) -> tuple[CubicSpline, CubicSpline, CubicSpline, float]:
        """s(θ), r(θ), θ(r) and the largest θ."""
        angles = np.linspace(0, _STEEPEST_STOP_ANGLE, _RAYS + 1)[1:]
        theta, shift, radius = chief_rays(self.lens, angles)
        with np.errstate(invalid="ignore"):
            rising = (np.diff(theta) > 0) & (np.diff(radius) > 0) & (theta[1:] < self.theta_max + 0.01)
        count = len(theta) if rising.all() else int(np.argmin(rising)) + 1
        theta, shift, radius = (np.concatenate([[0.0], curve[:count]]) for curve in (theta, shift, radius))
        even, odd = ((1, 0.0), "not-a-knot"), ((2, 0.0), "not-a-knot")
        curves = CubicSpline(theta, shift, bc_type=even), CubicSpline(theta, radius, bc_type=odd)
        return *curves, CubicSpline(radius, theta, bc_type=odd), min(float(theta[-1]), self.theta_max)

    @property
    def theta_limit(self) -> float:
        """Largest angle with a projection, rad."""
        return self._curves[3]

    def entrance_pupil(self, theta: ArrayLike) -> FloatArray:
        """E(θ) = −s(θ), metres, shape of θ (rad)."""
        result: FloatArray = -self._curves[0](np.asarray(theta, dtype=float))
        return result

    def radius_px(self, theta: ArrayLike) -> FloatArray:
        """Image radius in pixels, shape of θ (rad)."""
        result: FloatArray = self._curves[1](np.asarray(theta, dtype=float)) / self.pixel_pitch
        return result

    def incidence_angle(self, points: ArrayLike) -> tuple[np.ndarray, np.ndarray]:
        """θ (...) of the chief ray through points (..., 3), metres, and whether there is one (...).

        The ray of θ passes through (0, 0, s(θ)), so F(θ) = ρ cosθ − (z − s) sinθ = 0: Newton steps within a bracket
        that each evaluation narrows, and bisection where a step leaves it. F(0) = ρ ≥ 0, and the root in view is the
        one where F falls: outside the caustic F′ = −(ρ sinθ + (z − s) cosθ) + s′ sinθ < 0.
        """
        points = np.asarray(points, dtype=float)
        shift = self._curves[0]
        rho, z = np.hypot(points[..., 0], points[..., 1]), points[..., 2]
        low, high = np.zeros_like(rho), np.full_like(rho, self.theta_limit)
        theta = np.clip(np.arctan2(rho, z), 0, high)
        for _ in range(_ITERATIONS):
            value = rho * np.cos(theta) - (z - shift(theta)) * np.sin(theta)
            low, high = np.where(value >= 0, theta, low), np.where(value >= 0, high, theta)
            slope = self._slope(theta, rho, z)
            with np.errstate(divide="ignore", invalid="ignore"):
                step = theta - value / slope
            inside = (slope < 0) & (step >= low) & (step <= high)
            moved = np.where(inside, step, (low + high) / 2)
            done = np.abs(moved - theta).max(initial=0) < 1e-15
            theta = moved
            if done:
                break
        value = rho * np.cos(theta) - (z - shift(theta)) * np.sin(theta)
        solved = np.abs(value) <= 1e-12 * (1 + rho + np.abs(z))
        return theta, solved & (self._slope(theta, rho, z) < 0) & (theta <= self.theta_limit)

    def _slope(self, theta: FloatArray, rho: FloatArray, z: FloatArray) -> FloatArray:
        """∂F/∂θ, metres."""
        shift = self._curves[0]
        along = rho * np.sin(theta) + (z - shift(theta)) * np.cos(theta)
        result: FloatArray = shift(theta, 1) * np.sin(theta) - along
        return result

    def project(self, points: ArrayLike) -> tuple[np.ndarray, np.ndarray]:
        """Pixels (..., 2) and validity (...) of points (..., 3) in the camera frame, metres."""
        pixels, valid, _, _ = self.project_with_jacobian(points)
        return pixels, valid

    def project_with_jacobian(self, points: ArrayLike) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
        """``project`` with ∂pixels/∂point (..., 2, 3) and, for want of parameters, an empty (..., 2, 0).

        ∂θ/∂ρ = −cosθ/F′, ∂θ/∂z = sinθ/F′; on the axis r/ρ → r′(0) ∂θ/∂ρ.
        """
        points = np.asarray(points, dtype=float)
        theta, valid = self.incidence_angle(points)
        rho = np.hypot(points[..., 0], points[..., 1])
        slope = self._slope(theta, rho, points[..., 2])
        slope = np.where(slope < 0, slope, -1.0)
        radius, growth = self.radius_px(theta), self._curves[1](theta, 1) / self.pixel_pitch
        d_rho, d_z = -growth * np.cos(theta) / slope, growth * np.sin(theta) / slope
        off_axis = rho > 0
        safe = np.where(off_axis, rho, 1.0)
        cosine, sine = np.where(off_axis, points[..., 0] / safe, 1.0), points[..., 1] / safe
        around = np.where(off_axis, radius / safe, d_rho)
        pixels = np.stack([self.cx + radius * cosine, self.cy + radius * sine], axis=-1)
        first = [
            d_rho * cosine**2 + around * sine**2,
            (d_rho - around) * cosine * sine,
            d_z * cosine,
        ]
        second = [first[1], d_rho * sine**2 + around * cosine**2, d_z * sine]
        d_point = np.stack([np.stack(first, axis=-1), np.stack(second, axis=-1)], axis=-2)
        return pixels, valid, d_point, np.empty((*rho.shape, 2, 0))

    def unproject(self, pixels: ArrayLike) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """One ray a pixel (..., 2): origins (..., 3) on the axis, metres, unit directions (..., 3), valid (...)."""
        pixels = np.asarray(pixels, dtype=float)
        du, dv = pixels[..., 0] - self.cx, pixels[..., 1] - self.cy
        radius = np.hypot(du, dv)
        limit = self.radius_px(self.theta_limit)
        theta = self._curves[2](np.minimum(radius, limit) * self.pixel_pitch)
        safe = np.where(radius > 0, radius, 1.0)
        sine = np.sin(theta)
        directions = np.stack([sine * du / safe, sine * dv / safe, np.cos(theta)], axis=-1)
        origins = np.zeros_like(directions)
        origins[..., 2] = -self.entrance_pupil(theta)
        return origins, directions, radius <= limit


def laikin_camera() -> RayTracedCamera:
    """The 170° lens at f = 3.5 mm on 2048 × 2048 pixels of 4.32 µm: f = 809.36 px, 90° at 1015 px."""
    return RayTracedCamera(laikin_170(3.5e-3), (2048, 2048), 4.324395246974445e-6, 1027.4, 1019.8)


def published_camera(name: str, focal_length: float = 3.5e-3) -> RayTracedCamera:
    """A lens of PUBLISHED_LENSES at a focal length, metres, on 2048 × 2048 pixels; its field reaches 1000 px.

    The field is the one that the lens was designed for, and 2° more.
    """
    theta_max = np.radians(PUBLISHED_LENSES[name].half_field + 2)
    lens = published_lens(name, focal_length)
    radius = RayTracedCamera(lens, (2048, 2048), 1.0, 1027.4, 1019.8, theta_max).radius_px(theta_max)
    return RayTracedCamera(lens, (2048, 2048), float(radius) / _RIM, 1027.4, 1019.8, theta_max)
