"""A lens as a table of its surfaces, and its paraxial optics."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np


@dataclass(frozen=True)
class Prescription:
    """Centred spheres and planes, the scene before the first; lengths in any unit, light travels to the right.

    radii: of curvature, positive where the centre lies to the right; inf for a plane. thicknesses: from each surface
    to the next, the last one to the sensor. indices: of refraction behind each surface. stop: number of its surface,
    a plane in air.
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
    def back_focus(self) -> float:
        """From the last surface to where a far point is sharp: −h/u of a ray that came along the axis."""
        height, slope = self.paraxial(range(len(self.radii)), 1.0, 0.0)
        return -height / slope

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
