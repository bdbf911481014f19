"""A grid of black discs, symmetric or asymmetric, some of them holed to give it an identity."""

from __future__ import annotations

import logging
from dataclasses import dataclass

import numpy as np

from fisheye_ep_calib.plain_text import shown
from fisheye_ep_calib.target.base import Artwork, Target, bounding_board, rectangular_grid
from fisheye_ep_calib.target.detection import Detector
from fisheye_ep_calib.target.labelling import Placement, turns_onto_itself
from fisheye_ep_calib.target.schema import Keys

logger = logging.getLogger(__name__)


@dataclass(frozen=True, eq=False)
class CircleGrid(Target):
    """Discs of one radius, ``rows`` rows of ``columns``.

    Symmetric: neighbours lie ``spacing`` apart. Asymmetric (OpenCV's and Kalibr's): disc (column, row) lies
    at x = (2·column + row mod 2)·spacing, y = row·spacing. holed: indices row·columns + column of the discs
    with a white hole of ``hole_radius``; where no turn of the board leaves holes where holes are, it is
    unmistakable.
    """

    columns: int
    rows: int
    spacing: float
    asymmetric: bool
    holed: tuple[int, ...]
    hole_radius: float

    kind = "circle_grid"
    kalibr_kind = "circlegrid"

    @staticmethod
    def from_keys(keys: Keys, name: str) -> CircleGrid:
        keys.only(("type", "name", "columns", "rows", "spacing", "radius", "asymmetric", "holed", "hole_radius"))
        columns, rows = keys.count("columns", 2), keys.count("rows", 2)
        spacing, radius = keys.metres("spacing"), keys.metres("radius")
        asymmetric = keys.flag("asymmetric")
        holed = _holed(keys, columns, rows)
        hole_radius = keys.metres("hole_radius") if "hole_radius" in keys else 0.4 * radius
        _refuse_touching(keys, radius, spacing, asymmetric)
        if not 0.2 * radius <= hole_radius <= 0.7 * radius:
            raise keys.fail("hole_radius", "must lie between 0.2 and 0.7 of the radius")
        name = keys.text("name", name)
        return CircleGrid.create(name, columns, rows, spacing, radius, asymmetric, holed, hole_radius)

    @staticmethod
    def from_kalibr(keys: Keys, name: str) -> CircleGrid:
        """Kalibr's circlegrid says nothing of the discs' size; ``radius`` may be added to its keys."""
        keys.only(("target_type", "targetCols", "targetRows", "spacingMeters", "asymmetricGrid", "radius"))
        columns, rows = keys.count("targetCols", 2), keys.count("targetRows", 2)
        radius = keys.metres("radius") if "radius" in keys else None
        if radius is None:
            logger.warning(
                "%s: no radius of the discs is given: their centres are taken as points, which biases a calibration;"
                " add radius: METRES",
                keys.source,
            )
        spacing, asymmetric = keys.metres("spacingMeters"), keys.flag("asymmetricGrid")
        if radius is not None:
            _refuse_touching(keys, radius, spacing, asymmetric)
        return CircleGrid.create(name, columns, rows, spacing, radius, asymmetric)

    @staticmethod
    def create(
        name: str,
        columns: int,
        rows: int,
        spacing: float,
        radius: float | None,
        asymmetric: bool = False,
        holed: tuple[int, ...] = (),
        hole_radius: float = 0.0,
    ) -> CircleGrid:
        """Lengths in metres; radius None where it is not known (the centres are then taken as points)."""
        points = rectangular_grid(columns, rows, spacing, spacing)
        if asymmetric:
            row = np.repeat(np.arange(rows), columns)
            points[:, 0] = 2 * points[:, 0] + (row % 2) * spacing
        return CircleGrid(name, points, radius, columns, rows, spacing, asymmetric, tuple(holed), hole_radius)

    @property
    def lattice(self) -> np.ndarray:
        """Integer coordinates (n, 2) in the square lattice that nearest neighbours span.

        Its axes keep the handedness of x and y; those of an asymmetric grid are turned by 45°.
        """
        grid = np.rint(self.object_points[:, :2] / self.spacing).astype(int)
        if not self.asymmetric:
            return grid
        return np.stack([(grid[:, 0] + grid[:, 1]) // 2, (grid[:, 1] - grid[:, 0]) // 2], axis=-1)

    @property
    def pitch(self) -> float:
        """Distance of nearest neighbours, metres."""
        return self.spacing * (np.sqrt(2) if self.asymmetric else 1.0)

    @property
    def turns(self) -> list[Placement]:
        """Of the lattice, those that leave discs where discs are and holes where holes are; the identity is first."""
        return turns_onto_itself(self.lattice, self.lattice[list(self.holed)])

    @property
    def unmistakable(self) -> bool:
        return bool(self.holed) and len(self.turns) == 1

    @property
    def smallest_feature(self) -> float:
        return self.pitch / 1.5 if self.disc_radius is None else 2 * self.disc_radius

    def detector(self) -> Detector:
        from fisheye_ep_calib.target.discs.circle_grid_detector import CircleGridDetector

        return CircleGridDetector(self)

    def artwork(self) -> Artwork:
        radius = self.pitch / 3 if self.disc_radius is None else self.disc_radius
        low, high = bounding_board(self.object_points, radius + max(0.5 * radius, self.pitch - radius))
        discs = self.object_points.copy()
        discs[:, 2] = radius
        holes = discs[list(self.holed)].copy()
        holes[:, 2] = self.hole_radius
        return Artwork(low, high, discs=discs, holes=holes)


def _refuse_touching(keys: Keys, radius: float, spacing: float, asymmetric: bool) -> None:
    nearest = spacing * (np.sqrt(2) if asymmetric else 1)
    if 2 * radius >= 0.95 * nearest:
        raise keys.fail("radius", f"{radius:g} lets discs {nearest:g} m apart touch")


def _holed(keys: Keys, columns: int, rows: int) -> tuple[int, ...]:
    """Indices of the holed discs, given as [column, row] pairs or as indices."""
    value = keys.get("holed") or []
    if not isinstance(value, list):
        raise keys.fail("holed", "must be a list of [column, row]")
    indices = []
    for entry in value:
        if isinstance(entry, int) and not isinstance(entry, bool):
            entry = [entry % columns, entry // columns]
        whole = isinstance(entry, list) and len(entry) == 2 and all(type(i) is int for i in entry)
        if not whole or not (0 <= entry[0] < columns and 0 <= entry[1] < rows):
            raise keys.fail("holed", f"has {shown(entry)}, which is no [column, row] of a {columns}×{rows} grid")
        indices.append(entry[1] * columns + entry[0])
    if len(set(indices)) != len(indices):
        raise keys.fail("holed", "lists a disc twice")
    return tuple(sorted(indices))
