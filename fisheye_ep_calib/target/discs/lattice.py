"""Growing a square lattice through elliptic blobs, however the lens bends it.

Each blob is its own ruler: in the frame that makes its ellipse a unit circle, the board's lattice is locally
square, with a pitch of pitch/radius. Neighbours are blobs at that distance in both their frames; a lattice
grows from neighbour to neighbour, and each carries its frame's angle on.
"""

from __future__ import annotations

import heapq
from dataclasses import dataclass

import numpy as np
from scipy.spatial import cKDTree

NEAREST = 28  # blobs that may be a blob's neighbours
VOTES = 4  # nearest blobs that vote on the pitch where the radius is not known
FEWEST = 4  # discs of a lattice
QUARTER = np.pi / 2
# Blur makes blobs larger than their discs, and the pitch smaller in their measure.
SWOLLEN = (1.0, 0.82, 0.68)
MOST_OFF, MOST_UNLIKE = 0.17, 2.25  # of an edge's length in pitches off 1, and of one end's measure over the other's
MOST_CHANGE = 0.5  # from a step of a lattice line to the next, of the longer one
STEPS = ((1, 0), (0, 1), (-1, 0), (0, -1))


@dataclass(frozen=True)
class Lattice:
    """blob (k,): indices of blobs. cell (k, 2) int: lattice coordinates, of the handedness of (u, v)."""

    blob: np.ndarray
    cell: np.ndarray

    def __len__(self) -> int:
        return len(self.blob)


@dataclass(frozen=True)
class _Edges:
    """Neighbour relations, both ways. first, second (e,): blobs. angle (e,): direction in the frame of
    ``first``.
    cost (e,): how badly the distances fit. start (k + 1,): where each blob's edges begin (sorted by
    ``first``)."""

    first: np.ndarray
    second: np.ndarray
    angle: np.ndarray
    cost: np.ndarray
    start: np.ndarray


def grow_lattices(center: np.ndarray, shape: np.ndarray, ratio: float | None, enough: int = 0) -> list[Lattice]:
    """The lattices among blobs, largest first: center (k, 2), shape (k, 2, 2), pitch/radius (None: from the
    blobs). enough: points of a lattice that make a search for others, of discs swollen by blur, needless.
    """
    if len(center) < FEWEST:
        return []
    first, second, offset = _near_pairs(center, shape)
    ratios = [ratio * swollen for swollen in SWOLLEN] if ratio else _likely_ratios(offset, first, second, len(center))
    lattices: list[Lattice] = []
    for value in ratios:
        if ratio and max(map(len, lattices), default=0) >= enough > 0:
            break
        lattices += _grow_all(center, _edges(first, second, offset, value, len(center)))
    return sorted(lattices, key=len, reverse=True)


def _near_pairs(center: np.ndarray, shape: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Pairs (e,), (e,) of near blobs, both ways round, and second − first (e, 2) in the first's unit-circle
    frame.
    """
    neighbours = min(NEAREST, len(center) - 1)
    _, near = cKDTree(center).query(center, k=neighbours + 1)
    first = np.repeat(np.arange(len(center)), neighbours)
    second = near[:, 1:].ravel()
    key = np.unique(np.concatenate([first * len(center) + second, second * len(center) + first]))
    first, second = key // len(center), key % len(center)
    keep = first != second
    first, second = first[keep], second[keep]
    value, vector = np.linalg.eigh(shape)
    normalise = (vector / np.sqrt(np.maximum(value, 1e-9))[:, None, :]) @ np.swapaxes(vector, 1, 2)
    offset = np.einsum("eij,ej->ei", normalise[first], center[second] - center[first])
    return first, second, offset


def _both_ways(first: np.ndarray, second: np.ndarray, value: np.ndarray, count: int) -> np.ndarray:
    """The value of the reverse pair; pairs are sorted and come both ways round."""
    key = first * count + second
    result: np.ndarray = value[np.searchsorted(key, second * count + first)]
    return result


def _likely_ratios(offset: np.ndarray, first: np.ndarray, second: np.ndarray, count: int) -> list[float]:
    """pitch/radius from the commonest distance of a blob to its nearest ones, the commonest three."""
    distance = np.hypot(*offset.T)
    mutual = np.sqrt(distance * _both_ways(first, second, distance, count))
    # The nearest ones alone: eight lie √5 pitches away, and four one.
    order = np.lexsort((mutual, first))
    rank = np.arange(len(order)) - np.searchsorted(first[order], first[order])
    bins = np.arange(np.log(2.0), np.log(8.0), 0.06)
    votes, _ = np.histogram(np.log(np.maximum(mutual[order[rank < VOTES]], 1e-9)), bins)
    smooth = np.convolve(votes, np.ones(3), mode="same")
    best = np.argsort(-smooth)[:8]
    chosen: list[int] = []
    for index in best:
        if all(abs(index - other) > 3 for other in chosen):
            chosen.append(int(index))
    return [float(np.exp(bins[index] + 0.03)) for index in chosen[:3]]


def _edges(first: np.ndarray, second: np.ndarray, offset: np.ndarray, ratio: float, count: int) -> _Edges:
    """Pairs that are one pitch apart as the geometric mean of both frames has it, which is right to second order.

    What each end says by itself is not: on a coarse grid close by, the scale halves from one disc to the next.
    """
    distance = np.hypot(*offset.T) / ratio
    reverse = _both_ways(first, second, distance, count)
    mean = np.sqrt(distance * reverse)
    unlike = np.abs(np.log(np.maximum(distance, 1e-9) / np.maximum(reverse, 1e-9)))
    good = (np.abs(mean - 1) < MOST_OFF) & (unlike < np.log(MOST_UNLIKE))
    first, second, offset = first[good], second[good], offset[good]
    cost = np.abs(np.log(mean[good])) + 0.3 * unlike[good]
    start = np.searchsorted(first, np.arange(count + 1))
    return _Edges(first, second, np.arctan2(offset[:, 1], offset[:, 0]), cost, start)


def _snap(angle: float) -> tuple[int, float]:
    """Nearest quarter turn, 0–3, and what is left over."""
    turn = round(angle / QUARTER)
    return turn % 4, angle - turn * QUARTER


def _grow_all(center: np.ndarray, edges: _Edges) -> list[Lattice]:
    """The lattices grown from every blob not yet reached, best connected blobs first."""
    degree = np.diff(edges.start)
    free = degree >= 2
    lattices = []
    for seed in np.argsort(-np.minimum(degree, 4), kind="stable"):
        if not free[seed]:
            continue
        cells = _grow(int(seed), center, edges, free)
        free[list(cells)] = False
        if len(cells) >= FEWEST:
            lattices.append(Lattice(np.array(list(cells)), np.array(list(cells.values())).reshape(-1, 2)))
    return lattices


def _seed_angle(seed: int, edges: _Edges) -> float:
    """The frame angle that most of the seed's edges agree with, modulo a quarter turn."""
    own = slice(edges.start[seed], edges.start[seed + 1])
    angle, weight = edges.angle[own], np.exp(-6 * edges.cost[own])
    votes = [(weight * np.maximum(np.cos(4 * (angle - candidate)), 0)).sum() for candidate in angle]
    chosen = angle[int(np.argmax(votes))]
    near = np.cos(4 * (angle - chosen)) > 0
    return float(np.angle((weight[near] * np.exp(4j * angle[near])).sum()) / 4)


def _grow(seed: int, center: np.ndarray, edges: _Edges, free: np.ndarray) -> dict[int, tuple[int, int]]:
    """Cells by blob, grown from a seed along the most trustworthy edge first."""
    cells = {seed: (0, 0)}
    at = {(0, 0): seed}
    frame = {seed: _seed_angle(seed, edges)}
    queue: list[tuple[float, int, int, int, float]] = []

    def offer(blob: int) -> None:
        for edge in range(edges.start[blob], edges.start[blob + 1]):
            other = int(edges.second[edge])
            if other in cells or not free[other]:
                continue
            direction, rest = _snap(float(edges.angle[edge]) - frame[blob])
            if abs(rest) < 0.5:
                heapq.heappush(queue, (float(edges.cost[edge]) + 0.4 * abs(rest), blob, other, direction, rest))

    offer(seed)
    while queue:
        _, blob, other, direction, _ = heapq.heappop(queue)
        step = STEPS[direction]
        cell = (cells[blob][0] + step[0], cells[blob][1] + step[1])
        if other in cells or cell in at or not _in_line(center, at, cell, other):
            continue
        cells[other], at[cell] = cell, other
        frame[other] = _carry_frame(blob, other, direction, edges)
        offer(other)
    return cells


def _carry_frame(blob: int, other: int, direction: int, edges: _Edges) -> float:
    """The frame angle at ``other``: back along the edge by which it was reached, then the mean over its
    edges.
    """
    own = slice(edges.start[other], edges.start[other + 1])
    angle, target = edges.angle[own], edges.second[own]
    back = float(angle[np.flatnonzero(target == blob)[0]]) - (direction + 2) * QUARTER
    rest = (angle - back + QUARTER / 2) % QUARTER - QUARTER / 2
    near = np.abs(rest) < 0.35
    return back + float(rest[near].mean())


def _in_line(center: np.ndarray, at: dict[tuple[int, int], int], cell: tuple[int, int], other: int) -> bool:
    """Whether a blob continues the lattice lines that end beside its cell."""
    for step in STEPS:
        near = at.get((cell[0] - step[0], cell[1] - step[1]))
        if near is None:
            continue
        ahead = center[other] - center[near]
        far = at.get((cell[0] - 2 * step[0], cell[1] - 2 * step[1]))
        if far is not None:
            before = center[near] - center[far]
            if np.hypot(*(ahead - before)) > MOST_CHANGE * max(np.hypot(*before), np.hypot(*ahead)):
                return False
    return True
