"""A real fisheye lens, traced surface by surface: a truth that no camera model was made for.

The chief ray of every direction goes through the centre of the aperture stop. Traced from there to both sides it
gives, for one angle at the stop, the incidence angle θ before the lens, the place where that ray would cross the
axis (the entrance pupil for θ), and the height on the sensor.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from fisheye_ep_calib.arrays import FloatArray


@dataclass(frozen=True)
class Prescription:
    """Centred spherical surfaces, the scene before the first; lengths in any unit, light travels to the right.

    radii: of curvature, positive where the centre lies to the right; inf for a plane. thicknesses: from each surface
    to the next, the last one to the sensor. indices: of refraction behind each surface. stop: number of its surface,
    a plane that refracts nothing.
    """

    radii: tuple[float, ...]
    thicknesses: tuple[float, ...]
    indices: tuple[float, ...]
    stop: int

    @property
    def vertices(self) -> np.ndarray:
        """Position of each surface along the axis, the first at 0."""
        return np.concatenate([[0.0], np.cumsum(self.thicknesses)[:-1]])

    def paraxial(self, surfaces: range, height: float, slope: float) -> tuple[float, float]:
        """Paraxial trace to the right: height at the last of the surfaces, and slope behind it.

        n′u′ = n u − h (n′ − n)/R, h′ = h + t u.
        """
        index = 1.0 if surfaces.start == 0 else self.indices[surfaces.start - 1]
        for surface in surfaces:
            if surface > surfaces.start:
                height += self.thicknesses[surface - 1] * slope
            behind = self.indices[surface]
            slope = (index * slope - height * (behind - index) / self.radii[surface]) / behind
            index = behind
        return height, slope

    @property
    def focal_length(self) -> float:
        return -1.0 / self.paraxial(range(len(self.radii)), 1.0, 0.0)[1]

    @property
    def sensor(self) -> float:
        """Position of the sensor, from the first surface."""
        return float(self.vertices[-1] + self.thicknesses[-1])

    @property
    def entrance_pupil(self) -> float:
        """Position of the paraxial entrance pupil, from the first surface.

        A ray of height h and slope u at the first surface meets the stop at a height h A + u B. Where that is 0,
        the ray was aimed at the axis at −h/u = B/A, which is the pupil.
        """
        surfaces = range(self.stop)
        gap = self.thicknesses[self.stop - 1]
        by_height, by_slope = (
            height + gap * slope for height, slope in (self.paraxial(surfaces, *start) for start in ((1, 0), (0, 1)))
        )
        return by_slope / by_height

    def scaled(self, factor: float) -> Prescription:
        return Prescription(
            tuple(radius * factor for radius in self.radii),
            tuple(thickness * factor for thickness in self.thicknesses),
            self.indices,
            self.stop,
        )


def laikin_170(focal_length: float = 3.5e-3) -> Prescription:
    """M. Laikin, Lens Design, 4th ed., CRC Press 2007, p. 114: a 170° f/1.8 lens, scaled to a focal length, metres.

    The numbers are those of the PyPI package optiland 0.6.3 (MIT), optiland.samples.objectives.WideAngle170FOV;
    refractive indices n_d of N-BK7, N-SK5, SF1, N-LAK9 and N-PSK3 from Schott's catalogue.
    """
    bk7, sk5, sf1, lak9, psk3, air = 1.5168, 1.58913, 1.71736, 1.691, 1.55232, 1.0
    surfaces = (
        (6.0515, 0.1796, bk7),
        (1.2087, 0.9182, air),
        (-9.4697, 0.1939, sk5),
        (1.0053, 0.6402, air),
        (1.6634, 0.4518, sf1),
        (-1.6712, 0.1825, lak9),
        (1.1206, 2.5272, air),
        (1.3895, 0.2500, lak9),
        (0.5522, 0.6047, psk3),
        (-0.8844, 0.0196, air),
        (-0.8804, 0.0800, sf1),
        (-2.1545, 0.1200, air),
        (np.inf, 0.1200, air),
        (1.0354, 0.4830, psk3),
        (-0.8443, 0.0546, air),
        (-0.7386, 0.1076, sf1),
        (-1.5285, 0.8308, air),
    )
    radii, thicknesses, indices = zip(*surfaces, strict=True)
    lens = Prescription(radii, thicknesses, indices, stop=12)
    return lens.scaled(focal_length / lens.focal_length)


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
        center = vertex + radius
        # |p + t d − c|² = R²; of the two meetings the one nearer to the vertex.
        half = (z - center) * direction_z + y * direction_y
        with np.errstate(invalid="ignore"):
            root = np.sqrt(half**2 - ((z - center) ** 2 + y**2 - radius**2))
        distance = -half - np.sign(radius) * np.sign(direction_z) * root
        z, y = z + distance * direction_z, y + distance * direction_y
        ratio = behind / before if backwards else before / behind
        direction_z, direction_y = refract(direction_z, direction_y, (z - center) / radius, y / radius, ratio)
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
