"""Which point of the target is which: a patch of lattice found in an image is laid onto the target's own
lattice.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from fisheye_ep_calib.target.cells import extrapolate

SLACK = 0.07  # of a patch's points that may be no points of the target, where identity decides
# The four rotations of a square lattice; a reflection would mean looking at the board from behind.
ROTATIONS = np.array([[[1, 0], [0, 1]], [[0, -1], [1, 0]], [[-1, 0], [0, -1]], [[0, 1], [-1, 0]]])


@dataclass(frozen=True)
class Labels:
    """point_index (k,): the target's point for each of the patch's, -1 where the target has none."""

    point_index: np.ndarray

    @property
    def named(self) -> np.ndarray:
        return self.point_index >= 0


@dataclass(frozen=True)
class Placement:
    """c ↦ R c + s of lattice coordinates. rotation (2, 2), shift (2,): int."""

    rotation: np.ndarray
    shift: np.ndarray

    def __call__(self, cells: np.ndarray) -> np.ndarray:
        result: np.ndarray = cells @ self.rotation.T + self.shift
        return result

    def same(self, other: Placement) -> bool:
        return np.array_equal(self.rotation, other.rotation) and np.array_equal(self.shift, other.shift)

    def followed_by(self, turn: Placement) -> Placement:
        return Placement(turn.rotation @ self.rotation, turn(self.shift))


IDENTITY = Placement(ROTATIONS[0], np.zeros(2, dtype=int))


def turns_onto_itself(lattice: np.ndarray, marks: np.ndarray) -> list[Placement]:
    """The rotations that lay lattice (n, 2) int onto itself and marks (m, 2) int onto marks, the identity first."""
    turns = []
    for rotation in ROTATIONS:
        turn = Placement(rotation, lattice.min(axis=0) - (lattice @ rotation.T).min(axis=0))
        if all(set(map(tuple, turn(part).tolist())) == set(map(tuple, part.tolist())) for part in (lattice, marks)):
            turns.append(turn)
    return turns


def label_patch(
    cells: np.ndarray,
    pixels: np.ndarray,
    lattice: np.ndarray,
    allowed: Callable[[Placement], float] | None = None,
    is_plain: Callable[[np.ndarray, np.ndarray], np.ndarray] | None = None,
    least: float | None = None,
    turns: Sequence[Placement] = (IDENTITY,),
    preferred: Callable[[Placement], float] = lambda placement: 0.0,
) -> Labels:
    """Lay a patch onto the target's lattice.

    cells (k, 2) int: the patch's lattice coordinates, of the handedness of (u, v). pixels (k, 2). lattice (n,
    2) int: the target's. allowed: marks a placement by what the image says of identity (colours, holes);
    higher is better, −inf is impossible. is_plain(pixels (m, 2), scale (m,)): whether the image is plain
    board there, m sites next to the patch. least: the target has an identity: what the best placement must have
    of it at least, and clearly more than all others; else nothing is labelled. turns: those that leave the target as
    it is, the identity among them: what differs by one of them is no other placement. preferred: marks a placement by
    a convention; higher is better.

    The most points win, then identity, then the placement that expects no feature where the image shows plain
    board, then the convention. What is still ambiguous is settled by the target's x axis pointing to the right in the
    image.
    """
    low = lattice.min(axis=0)
    table = np.full(lattice.max(axis=0) - low + 1, -1)
    table[tuple((lattice - low).T)] = np.arange(len(lattice))
    unknown = Labels(np.full(len(cells), -1))
    # Where identity decides, a blob too many must not.
    slack = 0 if least is None else int(SLACK * len(cells))
    placements, overlap = _overlaps(cells, table >= 0, low, slack)
    best = max(overlap, default=0)
    if best == 0:
        return unknown
    plain = _plain_sites(cells, pixels, is_plain)
    ranked = []
    for placement, count in zip(placements, overlap, strict=True):
        if count < best - slack:
            continue
        identity = allowed(placement) if allowed else 0.0
        if np.isneginf(identity):
            continue
        contradictions = int((_look_up(table, placement(plain) - low) >= 0).sum())
        first = identity - (0 if least is None else contradictions)
        convention = preferred(placement), _rightward(cells, pixels, placement)
        ranked.append(((first, identity, count, -contradictions, *convention), placement))
    if not ranked:
        return unknown
    ranked.sort(key=lambda entry: entry[0], reverse=True)
    placement = ranked[0][1]
    alike = [placement.followed_by(turn) for turn in turns]
    rivals = [order for order, other in ranked if not any(other.same(labels) for labels in alike)]
    if least is not None and not _settled(ranked[0][0], rivals, least):
        return unknown
    return Labels(_look_up(table, placement(cells) - low))


def _settled(best: tuple[float, ...], rivals: Sequence[tuple[float, ...]], least: float) -> bool:
    """Whether the best of the placements, (identity less contradictions, identity, …), is the only one possible."""
    if best[1] < least:
        return False
    return all(best[0] >= rival[0] + 2 or best[1] >= rival[1] + 1 for rival in rivals)


def _look_up(table: np.ndarray, cells: np.ndarray) -> np.ndarray:
    inside = ((cells >= 0) & (cells < table.shape)).all(axis=-1)
    clipped = np.clip(cells, 0, np.array(table.shape) - 1)
    return np.where(inside, table[tuple(clipped.T)], -1)


def _overlaps(cells: np.ndarray, mask: np.ndarray, low: np.ndarray, slack: int) -> tuple[list[Placement], list[int]]:
    """For every rotation the shifts that put the most of the patch's cells, less ``slack``, on the target; how many."""
    placements, counts = [], []
    for rotation in ROTATIONS:
        turned = cells @ rotation.T
        corner = turned.min(axis=0)
        patch = np.zeros(turned.max(axis=0) - corner + 1)
        patch[tuple((turned - corner).T)] = 1
        # Correlation: overlap[s] counts cells c with mask[c - corner + s - (patch.shape - 1)].
        overlap = _correlation(mask, patch)
        for index in np.argwhere(overlap >= max(overlap.max() - slack, 1)):
            shift = index - (np.array(patch.shape) - 1) - corner + low
            placements.append(Placement(rotation, shift))
            counts.append(int(overlap[tuple(index)]))
    return placements, counts


def _rightward(cells: np.ndarray, pixels: np.ndarray, placement: Placement) -> float:
    """How far to the right the target's x axis points in the image, −1 to 1."""
    moved = placement(cells).astype(float)
    design = np.column_stack([moved, np.ones(len(moved))])
    step = np.linalg.lstsq(design, pixels, rcond=None)[0][0]
    return round(float(step[0] / max(np.hypot(*step), 1e-9)), 6)


def _plain_sites(
    cells: np.ndarray, pixels: np.ndarray, is_plain: Callable[[np.ndarray, np.ndarray], np.ndarray] | None
) -> np.ndarray:
    """Lattice sites beside the patch where the image shows plain board, so that no feature can be there."""
    if is_plain is None:
        return np.empty((0, 2), dtype=int)
    sites, where, scale = extrapolate(cells, pixels)
    return sites[is_plain(where, scale)] if len(sites) else sites


def _correlation(mask: np.ndarray, patch: np.ndarray) -> np.ndarray:
    """Full correlation (H + h − 1, W + w − 1), whole numbers, of a mask (H, W) and a patch (h, w) of zeros and ones."""
    shape = tuple(int(first + second - 1) for first, second in zip(mask.shape, patch.shape, strict=True))
    spectrum: np.ndarray = np.fft.rfft2(mask, shape)
    spectrum *= np.fft.rfft2(patch[::-1, ::-1], shape)
    return np.rint(np.fft.irfft2(spectrum, shape)).astype(int)
