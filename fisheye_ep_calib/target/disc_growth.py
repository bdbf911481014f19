"""Completing a patch of discs: what the search missed is measured where the lattice lines lead."""

from __future__ import annotations

import numpy as np

from fisheye_ep_calib.target.cells import extrapolate
from fisheye_ep_calib.target.disc_measurement import Measurement, measure_discs, minor_axis

MOST_ROUNDS = 20


def complete_discs(
    image: np.ndarray, cells: np.ndarray, discs: Measurement, ratio: float, hole: float, longest: int
) -> tuple[np.ndarray, Measurement]:
    """Cells (k, 2) and their measured discs with those that can be reached from them.

    ratio: pitch/radius. hole: radius of the holes that some discs may have, as a share of the disc's.
    longest: discs along the target's longer side. A disc that failed its measurement is not tried again.
    """
    taken = {tuple(cell) for cell in cells.tolist()}
    for _ in range(MOST_ROUNDS):
        good = np.flatnonzero(discs.good)
        if len(good) < 4:
            break
        sites, where, _ = extrapolate(cells[good], discs.center[good])
        extent = np.maximum(sites, cells[good].max(axis=0)) - np.minimum(sites, cells[good].min(axis=0)) + 1
        fresh = np.array([tuple(site) not in taken for site in sites.tolist()], dtype=bool)
        fresh &= (extent <= longest).all(axis=1) if len(sites) else fresh
        sites, where = sites[fresh], where[fresh]
        if len(sites) == 0:
            break
        taken.update(tuple(site) for site in sites.tolist())
        distance = np.abs(sites[:, None] - cells[good]).sum(axis=2)
        shape = discs.shape[good[distance.argmin(axis=1)]]
        found = measure_discs(image, where, shape, ratio, np.full(len(sites), hole))
        near = np.hypot(*(found.center - where).T) < 0.7 * minor_axis(shape)
        alike = np.abs(np.log(np.linalg.det(found.shape) / np.linalg.det(shape))) < 0.8
        contrast = found.contrast > 0.4 * np.median(discs.contrast[good])
        kept = found.good & near & alike & contrast
        if not kept.any():
            break
        cells = np.concatenate([cells, sites[kept]])
        discs = discs.joined(found[kept])
    return cells, discs
