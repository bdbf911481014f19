"""A real fisheye lens, traced surface by surface: a truth that no camera model was made for.

The chief ray of every direction goes through the centre of the aperture stop. Traced from there to both sides it
gives, for one angle at the stop, the incidence angle θ before the lens, the place where that ray would cross the
axis (the entrance pupil for θ), and the height on the sensor.
"""

from __future__ import annotations

import numpy as np

from fisheye_ep_calib.arrays import FloatArray
from fisheye_ep_calib.simulation.prescription import Prescription
from fisheye_ep_calib.simulation.published_lenses import published_lens


def laikin_170(focal_length: float = 3.5e-3) -> Prescription:
    """A 170° f/1.8 lens with a pupil that moves far, scaled to a focal length, metres."""
    return published_lens("laikin_170", focal_length)


def refract(
    direction_z: FloatArray, direction_y: FloatArray, normal_z: FloatArray, normal_y: FloatArray, ratio: float
) -> tuple[FloatArray, FloatArray]:
    """Snell's law for unit vectors in the meridional plane; ratio = n / n′. NaN on total reflection.

    d′ = μ d + (√(1 − μ²(1 − c²)) − μ c) n, with c = d·n made positive by the choice of n.
    """
    cosine = direction_z * normal_z + direction_y * normal_y
    sign = np.sign(cosine)
    normal_z, normal_y, cosine = normal_z * sign, normal_y * sign, cosine * sign
    with np.errstate(invalid="ignore"):
        along = np.sqrt(1 - ratio**2 * (1 - cosine**2)) - ratio * cosine
    return ratio * direction_z + along * normal_z, ratio * direction_y + along * normal_y


def _through(
    lens: Prescription,
    surfaces: range,
    z: FloatArray,
    y: FloatArray,
    direction_z: FloatArray,
    direction_y: FloatArray,
) -> tuple[FloatArray, FloatArray, FloatArray, FloatArray]:
    """Rays (k,) through surfaces, in either direction along the axis; positions lie on the last surface."""
    backwards = surfaces.step < 0
    for surface in surfaces:
        before = lens.indices[surface - 1] if surface > 0 else 1.0
        behind = lens.indices[surface]
        vertex, radius = lens.vertices[surface], lens.radii[surface]
        if np.isinf(radius):
            distance = (vertex - z) / direction_z
            z, y = z + distance * direction_z, y + distance * direction_y
            normal_z, normal_y = np.ones_like(z), np.zeros_like(z)
        else:
            center = vertex + radius
            # |p + t d − c|² = R²; of the two meetings the one nearer to the vertex.
            half = (z - center) * direction_z + y * direction_y
            with np.errstate(invalid="ignore"):
                root = np.sqrt(half**2 - ((z - center) ** 2 + y**2 - radius**2))
            distance = -half - np.sign(radius) * np.sign(direction_z) * root
            z, y = z + distance * direction_z, y + distance * direction_y
            normal_z, normal_y = (z - center) / radius, y / radius
        ratio = behind / before if backwards else before / behind
        direction_z, direction_y = refract(direction_z, direction_y, normal_z, normal_y, ratio)
    return z, y, direction_z, direction_y


def chief_rays(lens: Prescription, stop_angle: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """θ (rad), pupil shift s and image height r (k,) of chief rays that leave the stop's centre at angles (k,) > 0.

    s is measured along the axis towards the scene from the paraxial entrance pupil: s(θ) = −E(θ). NaN where a ray
    does not get through.
    """
    start = np.full(stop_angle.shape, lens.vertices[lens.stop])
    height = np.zeros_like(start)
    front = range(lens.stop - 1, -1, -1)
    z, y, direction_z, direction_y = _through(lens, front, start, height, -np.cos(stop_angle), np.sin(stop_angle))
    theta = np.arctan2(direction_y, -direction_z)
    shift = lens.entrance_pupil - (z - y * direction_z / direction_y)
    rear = range(lens.stop + 1, len(lens.radii))
    z, y, direction_z, direction_y = _through(lens, rear, start, height, np.cos(stop_angle), -np.sin(stop_angle))
    image_height = -(y + (lens.sensor - z) * direction_y / direction_z)
    return theta, shift, image_height
