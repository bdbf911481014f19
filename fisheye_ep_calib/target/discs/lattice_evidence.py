"""What speaks for a lattice of discs: each disc is a ruler, and all rulers of a printed grid agree.

In the frame that makes a disc's ellipse the unit circle, its neighbours lie pitch/radius away and at right angles,
however the lens bends the board. The geometric mean of what both ends of an edge say is right to second order.
"""

from __future__ import annotations

import numpy as np
from scipy.spatial import cKDTree

from fisheye_ep_calib.target.cells import line_residuals, local_pitch, neighbours

MOST_STRETCH = 0.35  # ln of pitch over radius off its median, for a disc to stay
MOST_SPREAD = 0.12  # RMS of the same over the lattice
MOST_SLANT = 0.25  # mean |cos| between rows and columns in the discs' frames
MOST_BIAS = 0.13  # ln of pitch over radius off the target's
MOST_BEND = 0.12  # median step off a straight row, in pitches; up to twice as much where all else is perfect
FEWEST_SQUARES = 2  # of four discs; one where all else is within EXCELLENT of its limit
EXCELLENT = 0.25


def frames(shape: np.ndarray) -> np.ndarray:
    """Matrices (k, 2, 2) that make the ellipses x' shape⁻¹ x = 1 unit circles."""
    return np.linalg.inv(np.linalg.cholesky(shape))


def mean_distance(frame: np.ndarray, center: np.ndarray, first: np.ndarray, second: np.ndarray) -> np.ndarray:
    """Distance (e,) from disc ``first`` to ``second``, in radii: geometric mean of what both say."""
    offset = (center[second] - center[first])[:, :, None]
    forward = np.linalg.norm((frame[first] @ offset)[..., 0], axis=1)
    backward = np.linalg.norm((frame[second] @ offset)[..., 0], axis=1)
    result: np.ndarray = np.sqrt(forward * backward)
    return result


def lattice_edges(cells: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Pairs (e,), (e,) of cells (k, 2) that are neighbours in the lattice."""
    beside = neighbours(cells)
    first, side = np.nonzero(beside[:, [0, 2]] >= 0)
    return first, beside[first, 2 * side]


def fits_neighbours(cells: np.ndarray, center: np.ndarray, shape: np.ndarray) -> np.ndarray:
    """Whether each disc (k,) lies as far from its neighbours as is usual in the lattice; true for a lone one."""
    first, second = lattice_edges(cells)
    if len(first) == 0:
        return np.ones(len(cells), dtype=bool)
    stretch = np.log(np.maximum(mean_distance(frames(shape), center, first, second), 1e-6))
    strange = np.abs(stretch - np.median(stretch)) > MOST_STRETCH
    edges = np.bincount(np.concatenate([first, second]), minlength=len(cells))
    wrong = np.bincount(np.concatenate([first[strange], second[strange]]), minlength=len(cells))
    # One wrong disc makes an edge of each of its neighbours look wrong, but not the most of them.
    result: np.ndarray = (wrong == 0) | (2 * wrong < edges)
    return result


def pitch_over_radius(cells: np.ndarray, center: np.ndarray, shape: np.ndarray) -> float:
    """The distance of neighbouring discs over their radius, as k measured discs show it, whatever the lens."""
    first, second = lattice_edges(cells)
    return float(np.median(mean_distance(frames(shape), center, first, second)))


def is_disc_lattice(cells: np.ndarray, center: np.ndarray, shape: np.ndarray, ratio: float | None) -> bool:
    """Whether k measured discs are a grid with this pitch/radius (None: any) seen through a lens."""
    first, second = lattice_edges(cells)
    beside = neighbours(cells)
    right, down = beside[:, 0], beside[:, 2]
    squares = int(((right >= 0) & (down >= 0) & (beside[right, 2] >= 0)).sum())
    if squares < 1:
        return False
    frame = frames(shape)
    stretch = np.log(np.maximum(mean_distance(frame, center, first, second), 1e-6))
    usual = float(np.median(stretch))
    spread = float(np.sqrt(np.mean((stretch - usual) ** 2)))
    bias = 0.0 if ratio is None else abs(usual - np.log(ratio))
    worst = max(spread / MOST_SPREAD, bias / MOST_BIAS, _slant(beside, frame, center) / MOST_SLANT)
    if squares < FEWEST_SQUARES and worst > EXCELLENT:
        return False
    rest = line_residuals(cells, center) / local_pitch(cells, center)
    finite = np.isfinite(rest)
    bent = float(np.median(rest[finite])) if finite.sum() >= 4 else 0.0
    # Rulers that agree well are evidence of a grid: its rows may bend the more.
    return worst < 1 and bent / MOST_BEND < 2 - worst


def _slant(beside: np.ndarray, frame: np.ndarray, center: np.ndarray) -> float:
    """Mean |cos| of the angles between neighbours along the lattice's two axes, in the discs' frames."""
    slants = []
    for along in (0, 1):
        for across in (2, 3):
            index = np.flatnonzero((beside[:, along] >= 0) & (beside[:, across] >= 0))
            first, second = (
                (frame[index] @ (center[beside[index, side]] - center[index])[:, :, None])[..., 0]
                for side in (along, across)
            )
            length = np.linalg.norm(first, axis=1) * np.linalg.norm(second, axis=1)
            slants.append(np.abs((first * second).sum(axis=1)) / np.maximum(length, 1e-9))
    return float(np.concatenate(slants).mean())


def is_every_second(cells: np.ndarray, center: np.ndarray, blobs: np.ndarray) -> bool:
    """Whether blobs (b, 2) fill the middles of the lattice's squares: then it is a diagonal part of a finer one."""
    beside = neighbours(cells)
    right, down = beside[:, 0], beside[:, 2]
    across = np.where((right >= 0) & (down >= 0), beside[right, 2], -1)
    whole = np.flatnonzero(across >= 0)
    if len(whole) == 0 or len(blobs) == 0:
        return False
    corners = center[np.stack([whole, right[whole], down[whole], across[whole]])]
    distance, _ = cKDTree(blobs).query(corners.mean(axis=0))
    side = np.linalg.norm(corners[1] - corners[0], axis=1)
    other = np.linalg.norm(corners[2] - corners[0], axis=1)
    return bool((distance < 0.2 * np.minimum(side, other)).mean() > 0.4)
