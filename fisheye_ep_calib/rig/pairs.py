"""Where two cameras are to each other, by the views in which both see the target.

Every common view says a_from_b = A S B⁻¹ with the target's poses A and B in the two cameras and, where the target
can be mistaken for itself turned, one of its symmetries S: which one is not known. The right answer is the one that
the views agree on.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from fisheye_ep_calib.arrays import FloatArray
from fisheye_ep_calib.rig.symmetry import Symmetry

WORST_DISAGREEMENT = 0.2  # of the distance to the target: poses that differ by more agree on nothing
_OTHER = 0.10  # of that distance: answers that differ by more are different answers
_CLEAR = 2.0  # the best answer fits this many times better than the next one
_MOST_PROPOSING = 200  # views that propose answers; all judge them, so that the cost goes with the views
_MOST_AT_ONCE = 20_000  # poses: bounds the memory


@dataclass(frozen=True)
class PairPose:
    """a_from_b (4, 4). views: how many agree on it. disagreement: RMS of those, as a fraction of the distance.

    ambiguous: another answer fits as well, because the target looks the same turned. common: how many views there are.
    """

    a_from_b: np.ndarray
    views: int
    disagreement: float
    ambiguous: bool
    common: int = 0


def pair_pose(
    a_from_target: np.ndarray, b_from_target: np.ndarray, symmetries: Sequence[Symmetry], points: np.ndarray
) -> PairPose:
    """The relative pose that most of the common views agree on, among those that a part of the views proposes.

    a_from_target, b_from_target (V, 4, 4): poses in the same views, V ≥ 1. points (n, 3): the target's, metres.
    """
    turned = np.stack([a_from_target @ symmetry.motion for symmetry in symmetries], axis=1)
    # Drawn, as wrong views may come at regular intervals.
    proposing = np.sort(np.random.default_rng(0).permutation(len(turned))[:_MOST_PROPOSING])
    candidates = (turned[proposing] @ np.linalg.inv(b_from_target[proposing])[:, None]).reshape(-1, 4, 4)
    disagreement = np.stack([_disagreement(candidate, turned, b_from_target, points) for candidate in candidates])
    square = np.minimum(disagreement, WORST_DISAGREEMENT) ** 2
    best = int(np.argmin(square.mean(axis=1)))
    chosen = candidates[best]
    agreeing = disagreement[best] < WORST_DISAGREEMENT
    cost = square[:, agreeing].mean(axis=1)
    ambiguous = False
    if len(symmetries) > 1:
        parts = np.array_split(candidates, 1 + len(candidates) * len(turned) // _MOST_AT_ONCE)
        apart = np.concatenate([_apart(part, chosen, b_from_target, points) for part in parts])
        others = cost[apart > _OTHER]
        ambiguous = bool(len(others) and others.min() < _CLEAR**2 * cost[best] + 1e-12)
    return PairPose(chosen, int(agreeing.sum()), float(np.sqrt(cost[best])), ambiguous, len(agreeing))


def best_symmetry(
    expected: np.ndarray, measured: np.ndarray, symmetries: Sequence[Symmetry], points: np.ndarray
) -> tuple[int, float]:
    """Which symmetry makes a pose that was found (4, 4) most like an expected one, and how far off it is then."""
    turned = np.stack([measured @ symmetry.motion for symmetry in symmetries])
    off = _relative_distance(turned, expected[None], points)
    best = int(np.argmin(off))
    return best, float(off[best])


def _disagreement(
    a_from_b: np.ndarray, turned: np.ndarray, b_from_target: np.ndarray, points: np.ndarray
) -> np.ndarray:
    """How far each view (V,) is off, by its best symmetry; turned (V, G, 4, 4)."""
    nearest: FloatArray = _relative_distance(turned, (a_from_b @ b_from_target)[:, None], points).min(axis=1)
    return nearest


def _apart(candidates: np.ndarray, chosen: np.ndarray, b_from_target: np.ndarray, points: np.ndarray) -> np.ndarray:
    """How far candidates (K, 4, 4) put the boards from where the chosen one puts them (K,), at the median."""
    distance = _relative_distance(candidates[:, None] @ b_from_target, chosen @ b_from_target, points)
    middle: FloatArray = np.median(distance, axis=1)
    return middle


def _relative_distance(first: np.ndarray, second: np.ndarray, points: np.ndarray) -> np.ndarray:
    """RMS distance (...) between the target's points at two poses (..., 4, 4), over their distance from the camera."""
    spread = np.cov(points.T, bias=True)
    middle = points.mean(axis=0)
    turn = first[..., :3, :3] - second[..., :3, :3]
    shift = (first - second)[..., :3, 3] + turn @ middle
    # Mean of |turn p + shift|² over the points: the middle's part and that of the spread around it.
    square = (shift**2).sum(axis=-1) + np.einsum("...ij,jk,...ik->...", turn, spread, turn)
    place = 0.5 * (first + second)[..., :3, 3] + 0.5 * (first + second)[..., :3, :3] @ middle
    relative: FloatArray = np.sqrt(np.maximum(square, 0)) / np.maximum(np.linalg.norm(place, axis=-1), 1e-9)
    return relative
