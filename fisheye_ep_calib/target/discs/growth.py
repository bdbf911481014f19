"""Completing a patch of discs: what the search missed is measured where the lattice lines lead."""

from __future__ import annotations

import numpy as np

from fisheye_ep_calib.target.cells import extrapolate
from fisheye_ep_calib.target.discs.ellipse import minor_axis
from fisheye_ep_calib.target.discs.lattice_evidence import MOST_STRETCH, frames, lattice_edges, mean_distance
from fisheye_ep_calib.target.discs.measurement import Measurement, measure_discs

MOST_ROUNDS = 40  # of growing by a row
FARTHEST = 3  # places that may be missed on end


def complete_discs(
    image: np.ndarray, cells: np.ndarray, discs: Measurement, ratio: float, hole: float, longest: int
) -> tuple[np.ndarray, Measurement]:
    """Cells (k, 2) and their measured discs with those that can be reached from them.

    ratio: pitch/radius. hole: radius of the holes that some discs may have, as a share of the disc's.
    longest: discs along the target's longer side. A disc that failed its measurement is not tried again.
    """
    taken = {tuple(cell) for cell in cells.tolist()}
    ahead = 1
    for _ in range(MOST_ROUNDS):
        good = np.flatnonzero(discs.good)
        if len(good) < 4 or ahead > FARTHEST:
            break
        sites, where = _fresh_sites(cells[good], discs.center[good], taken, longest, ahead)
        if ahead == 1:
            taken.update(tuple(site) for site in sites.tolist())
        kept = np.zeros(len(sites), dtype=bool)
        if len(sites):
            nearest = np.abs(sites[:, None] - cells[good]).sum(axis=2).argmin(axis=1)
            shape = discs.shape[good[nearest]]
            fresh = measure_discs(image, where, shape, ratio, np.full(len(sites), hole))
            kept = _belongs(fresh, where, shape, np.median(discs.contrast[good]))
            kept[kept] = _apart(fresh[kept], sites[kept], cells[good], discs[good])
        if kept.any():
            cells, discs = np.concatenate([cells, sites[kept]]), discs.joined(fresh[kept])
            taken.update(tuple(site) for site in sites[kept].tolist())
        # Beyond something that hides a disc the lattice may go on.
        ahead = 1 if kept.any() else ahead + 1
    return cells, discs


def _fresh_sites(
    cells: np.ndarray, pixels: np.ndarray, taken: set[tuple[int, int]], longest: int, ahead: int
) -> tuple[np.ndarray, np.ndarray]:
    """Sites (m, 2) that were not tried and leave the patch no longer than the target, and their pixels (m,
    2).
    """
    sites, where, _ = extrapolate(cells, pixels, ahead)
    extent = np.maximum(sites, cells.max(axis=0)) - np.minimum(sites, cells.min(axis=0)) + 1
    fresh = np.array([tuple(site) not in taken for site in sites.tolist()], dtype=bool)
    fresh &= (extent <= longest).all(axis=1)
    return sites[fresh], where[fresh]


def _belongs(fresh: Measurement, where: np.ndarray, shape: np.ndarray, contrast: float) -> np.ndarray:
    """Whether each disc is seen whole, near where it should be (m, 2), and of the size and contrast of its
    like.
    """
    near = np.hypot(*(fresh.center - where).T) < 0.7 * minor_axis(shape)
    alike = np.abs(np.log(np.linalg.det(fresh.shape) / np.linalg.det(shape))) < 0.8
    result: np.ndarray = fresh.good & near & alike & (fresh.contrast > 0.4 * contrast)
    return result


def _apart(fresh: Measurement, sites: np.ndarray, cells: np.ndarray, discs: Measurement) -> np.ndarray:
    """Whether each new disc (m,) at sites (m, 2) lies as far from the patch's discs as its place in the lattice says.

    Where the board ends, lines lead back to discs that are known already.
    """
    if len(sites) == 0:
        return np.zeros(0, dtype=bool)
    count = len(cells)
    center, frame = np.concatenate([discs.center, fresh.center]), frames(np.concatenate([discs.shape, fresh.shape]))
    first, second = lattice_edges(cells)
    pitch = np.median(mean_distance(frame, center, first, second)) if len(first) else 1.0
    apart = np.linalg.norm(fresh.center[:, None] - center, axis=2)
    apart[np.arange(len(sites)), count + np.arange(len(sites))] = np.inf
    beside = apart.argmin(axis=1)
    new = count + np.arange(len(sites))
    near = mean_distance(frame, center, new, beside) / pitch
    steps = np.linalg.norm(sites[:, None] - cells, axis=2)
    nearest = steps.argmin(axis=1)
    stretch = mean_distance(frame, center, new, nearest) / (pitch * steps[np.arange(len(sites)), nearest])
    result: np.ndarray = (near > 0.6) & (np.abs(np.log(np.maximum(stretch, 1e-6))) < MOST_STRETCH)
    return result
