"""Completing a patch of chessboard corners: each round looks where the lattice lines lead."""

from __future__ import annotations

import numpy as np

from fisheye_ep_calib.target.cells import extrapolate, local_axes, neighbours
from fisheye_ep_calib.target.corners.refinement import looks_like_corner, reach_of, refine_corners

MOST_ROUNDS = 60  # of growing by a row
FARTHEST = 3  # places that may be missed on end


def colour_parity(image: np.ndarray, cells: np.ndarray, pixels: np.ndarray) -> int:
    """0 where the squares down and right of cells with an even sum are black, 1 where those with an odd sum
    are.

    −1 when no square is whole or the colours do not differ.
    """
    beside = neighbours(cells)
    right, down = beside[:, 0], beside[:, 2]
    across = np.where((right >= 0) & (down >= 0), beside[right, 2], -1)
    whole = np.flatnonzero(across >= 0)
    centre = (pixels[whole] + pixels[right[whole]] + pixels[down[whole]] + pixels[across[whole]]) / 4
    column, row = np.rint(centre).astype(int).T
    value = image[np.clip(row, 0, image.shape[0] - 1), np.clip(column, 0, image.shape[1] - 1)].astype(float)
    odd = cells[whole].sum(axis=1) % 2 == 1
    if odd.all() or not odd.any():
        return -1
    difference = np.median(value[odd]) - np.median(value[~odd])
    return -1 if difference == 0 else int(difference < 0)


def grow_corners(
    image: np.ndarray, cells: np.ndarray, pixels: np.ndarray, parity: int, longest: int
) -> tuple[np.ndarray, np.ndarray]:
    """The patch with every corner that can be reached from it; longest: the target's longer side, in corners."""
    refused: set[tuple[int, int]] = set()
    ahead = 1
    for _ in range(MOST_ROUNDS):
        if ahead > FARTHEST:
            break
        sites, where, _ = extrapolate(cells, pixels, ahead)
        extent = np.maximum(sites, cells.max(axis=0)) - np.minimum(sites, cells.min(axis=0)) + 1
        fresh = np.array([tuple(site) not in refused for site in sites.tolist()], dtype=bool)
        fresh &= (extent <= longest).all(axis=1)
        sites, where = sites[fresh], where[fresh]
        good, refined = _examine(image, cells, pixels, sites, where, parity)
        if ahead == 1:
            refused.update(tuple(site) for site in sites[~good].tolist())
        cells, pixels = np.concatenate([cells, sites[good]]), np.concatenate([pixels, refined[good]])
        # Beyond something that hides a corner the lattice may go on.
        ahead = 1 if good.any() else ahead + 1
    return cells, pixels


def _examine(
    image: np.ndarray, cells: np.ndarray, pixels: np.ndarray, sites: np.ndarray, where: np.ndarray, parity: int
) -> tuple[np.ndarray, np.ndarray]:
    """Whether there is a corner near each site's pixel where (m, 2), and its position (m, 2)."""
    if len(sites) == 0:
        return np.zeros(0, dtype=bool), where
    distance = np.abs(sites[:, None] - cells).sum(axis=2)
    axes, defined = local_axes(cells, pixels)
    distance[:, ~defined] += 1000
    nearest = distance.argmin(axis=1)
    half = 0.5 * axes[nearest]
    reach = reach_of(half)
    refined, good = refine_corners(image, where, reach)
    good &= defined[nearest] & (np.hypot(*(refined - where).T) < 0.6 * reach)
    bright = np.where(sites.sum(axis=1) % 2 == parity, -1.0, 1.0)
    return good & looks_like_corner(image, refined, half, bright), refined
