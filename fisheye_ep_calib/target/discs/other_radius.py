"""Whether an image without the target's discs shows discs of another size: then the target's file is to blame."""

from __future__ import annotations

from typing import Protocol

import cv2
import numpy as np

from fisheye_ep_calib.target.discs.blobs import WINDOWS, Blobs, find_blobs, reduced, usual_factor
from fisheye_ep_calib.target.discs.lattice import Lattice, grow_lattices
from fisheye_ep_calib.target.discs.lattice_evidence import (
    fits_neighbours,
    is_disc_lattice,
    is_every_second,
    pitch_over_radius,
)
from fisheye_ep_calib.target.discs.measurement import measure_discs

MOSTLY_SEEN = 0.6  # share of the target's discs that a grid of another radius must have
MOST = 1.5  # times as many
UNUSUAL = 1.1  # times the file's radius, or its inverse: less is no other radius


class DiscsOfRadius(Protocol):
    """What the file has (boards/circle_grid.py), metres."""

    @property
    def object_points(self) -> np.ndarray: ...
    @property
    def pitch(self) -> float: ...
    @property
    def disc_radius(self) -> float | None: ...
    @property
    def holed(self) -> tuple[int, ...]: ...


def other_radius(image: np.ndarray, target: DiscsOfRadius) -> str:
    """What to say of a grid in an image (h, w) that is the target's but for its discs' radius; empty where none is.

    Dark discs, then light ones, as small as the usual search sees them.
    """
    if target.disc_radius is None:
        return ""
    factor = usual_factor(image.shape)
    for picture in (image, cv2.bitwise_not(image)):
        blobs = find_blobs(reduced(picture, factor), WINDOWS, holes=bool(target.holed)).scaled(factor)
        for lattice in grow_lattices(blobs.center, blobs.shape, None)[:2]:
            share = len(lattice) / len(target.object_points)
            count, ratio = _grid(picture, blobs, lattice) if MOSTLY_SEEN <= share <= MOST else (0, 0.0)
            radius = target.pitch / ratio if count else target.disc_radius
            times = radius / target.disc_radius
            if max(times, 1 / times) > UNUSUAL:
                return (
                    f"{count} discs are seen whose radius is {times:.2f} times what the target file has for this "
                    f"spacing: check radius ({radius:.3g} m would fit)"
                )
    return ""


def _grid(image: np.ndarray, blobs: Blobs, lattice: Lattice) -> tuple[int, float]:
    """How many discs of a lattice are a grid of some radius, and its pitch over the radius; 0 where it is none."""
    chosen = blobs[lattice.blob]
    rough = pitch_over_radius(lattice.cell, chosen.center, chosen.shape)
    discs = measure_discs(
        image, chosen.center, chosen.shape, rough, np.where(chosen.hole > 0, np.sqrt(chosen.hole), 0.0)
    )
    good = discs.good.copy()
    if good.any():
        good[good] = fits_neighbours(lattice.cell[good], discs.center[good], discs.shape[good])
    cells, discs = lattice.cell[good], discs[good]
    if len(cells) < MOSTLY_SEEN * len(lattice) or not is_disc_lattice(cells, discs.center, discs.shape, None):
        return 0, 0.0
    if is_every_second(cells, discs.center, blobs.center):
        return 0, 0.0
    return len(cells), pitch_over_radius(cells, discs.center, discs.shape)
