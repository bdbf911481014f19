"""Which discs of a grid have the white hole that gives it an identity, measured at full resolution."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from fisheye_ep_calib.target.discs.ellipse import EllipsePosition, half_box, minor_axis
from fisheye_ep_calib.target.discs.measurement import Measurement
from fisheye_ep_calib.target.labelling import Placement
from fisheye_ep_calib.target.pixel_patches import PixelPatches

LEAST_BRIGHTNESS, ENOUGH_BRIGHTNESS = 0.12, 0.4  # of board minus disc: never a hole, always one
LEAST_NOISES = 6.0  # times the spread of the plain discs: a hole
LEAST_HOLES = 1.0  # net, where the target has them, for names to be believed: plain board alone may be a sheet of paper
VISIBLE = 0.3  # share of a hole's brightness that the blur must leave for its absence to be seen


@dataclass(frozen=True)
class HoleEvidence:
    """cells (k, 2): of the discs. holed, plain (k,) bool: seen to have a hole, seen to have none; neither is possible.

    marks: the lattice places of the target's holed discs.
    """

    cells: np.ndarray
    holed: np.ndarray
    plain: np.ndarray
    marks: frozenset[tuple[int, int]]

    def __call__(self, placement: Placement) -> float:
        """Holes where the target has them, less those missing and those where it has none."""
        marked = np.array([tuple(cell) in self.marks for cell in placement(self.cells).tolist()], dtype=bool)
        return float((marked & self.holed).sum() - (marked & self.plain).sum() - (~marked & self.holed).sum())


def hole_evidence(
    image: np.ndarray, cells: np.ndarray, discs: Measurement, hole: float, marks: np.ndarray
) -> HoleEvidence:
    """Look for holes in measured discs at cells (k, 2). hole: its radius as a share of the disc's. marks (m, 2)."""
    excess = _brightness(image, discs, hole)
    measured = discs.good & np.isfinite(excess)
    usual = float(np.median(excess[measured])) if measured.any() else 0.0
    noise = 1.4826 * float(np.median(np.abs(excess[measured] - usual))) if measured.any() else 0.0
    holed = measured & (excess - usual > np.clip(LEAST_NOISES * noise, LEAST_BRIGHTNESS, ENOUGH_BRIGHTNESS))
    # A hole narrower than the blur would not be seen: 1 − exp(−a²/2σ²) is what a Gaussian leaves in its middle.
    radius = hole * minor_axis(discs.shape)
    left = 1 - np.exp(-(radius**2) / (2 * np.maximum(discs.blur, 0.3) ** 2))
    plain = measured & ~holed & (left > VISIBLE)
    return HoleEvidence(cells, holed, plain, frozenset(map(tuple, marks.tolist())))


def _brightness(image: np.ndarray, discs: Measurement, hole: float) -> np.ndarray:
    """How much brighter the middle of each disc (k,) is than the rest, as a share of board minus disc."""
    result = np.full(len(discs.center), np.nan)
    index = np.flatnonzero(discs.good)
    if len(index) == 0:
        return result
    some = discs[index]
    patches = PixelPatches.cut(image, some.center, half_box(some.shape) + 0.5)
    radius = EllipsePosition.of(patches, some.shape).radius
    middle = (radius < 0.6 * hole) | (patches.x**2 + patches.y**2 < 0.75**2)
    around = ~middle & (np.abs(radius - (1 + hole) / 2) < 0.25 * (1 - hole))
    enough = (patches.sum(middle) > 0) & (patches.sum(around) > 2)
    step = patches.mean(patches.value, middle) - patches.mean(patches.value, around)
    result[index] = np.where(enough, step / np.maximum(some.contrast, 1), np.nan)
    return result
