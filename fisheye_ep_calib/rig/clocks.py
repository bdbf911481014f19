"""A constant difference between the clocks of two cameras, from how the target moved before both.

With the true difference every common view says the same a_from_b; with another one the target stood elsewhere when the
other camera saw it, and the views contradict each other.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from fisheye_ep_calib.rig.pairs import WORST_DISAGREEMENT, PairPose, pair_pose
from fisheye_ep_calib.rig.symmetry import Symmetry
from fisheye_ep_calib.rig.synchronisation import simultaneous

_LEAST_VIEWS = 3
_MOST_CANDIDATES = 300
_SCORED_VIEWS = 24
_MOST_DIFFERENCES = 4_000_000  # of pairs of images: more propose nothing that these do not
_ENOUGH = 0.5  # of the most common views that any difference gives
_CLEAR = 1.5  # times as well as any other difference the found one makes the views agree


@dataclass(frozen=True)
class ClockOffset:
    """offset_ns: b's clock less a's. common: views of the same time then; agreeing: how many of these say the same."""

    offset_ns: int
    common: int
    agreeing: int


def clock_offset(
    a_stamps_ns: np.ndarray,
    a_from_target: np.ndarray,
    b_stamps_ns: np.ndarray,
    b_from_target: np.ndarray,
    symmetries: Sequence[Symmetry],
    points: np.ndarray,
    tolerance_ns: int,
) -> ClockOffset | None:
    """The difference of two clocks that makes the views agree; None where none does, or several do as well.

    a_stamps_ns (A,) and a_from_target (A, 4, 4): when and where camera a saw the target; so for b. points (n, 3): the
    target's, metres. Images whose stamps, so corrected, lie within the tolerance are of the same time.
    """
    a_stamps, b_stamps = (np.asarray(stamps, dtype=np.int64) for stamps in (a_stamps_ns, b_stamps_ns))
    scored: list[tuple[float, int]] = []
    for offset in _candidates(a_stamps, b_stamps, max(tolerance_ns, 1)):
        common = _common(a_stamps, b_stamps, offset, tolerance_ns)
        few = common[np.unique(np.linspace(0, len(common) - 1, min(len(common), _SCORED_VIEWS)).round().astype(int))]
        pair = pair_pose(a_from_target[few[:, 0]], b_from_target[few[:, 1]], symmetries, points)
        scored.append((_cost(pair, len(few)), offset))
    if not scored:
        return None
    scored.sort()
    cost, offset = scored[0]
    if len(scored) > 1 and scored[1][0] < _CLEAR**2 * cost + 1e-12:
        return None
    common = _common(a_stamps, b_stamps, offset, tolerance_ns)
    pair = pair_pose(a_from_target[common[:, 0]], b_from_target[common[:, 1]], symmetries, points)
    if pair.views < _LEAST_VIEWS or 2 * pair.views <= len(common):
        return None
    return ClockOffset(offset, len(common), pair.views)


def clocks_of_rig(
    stamps_ns: Sequence[np.ndarray],
    camera_from_target: Sequence[dict[int, np.ndarray]],
    symmetries: Sequence[Symmetry],
    points: np.ndarray,
    tolerance_ns: int,
) -> list[int | None]:
    """Each camera's clock less the first one's, ns; None for a camera whose views agree with no other's.

    stamps_ns: of each camera's images. camera_from_target: of each camera, image number → pose (4, 4).
    """
    images = [np.array(sorted(poses), dtype=int) for poses in camera_from_target]
    stamps = [
        np.asarray(of_all, dtype=np.int64)[of_camera] for of_all, of_camera in zip(stamps_ns, images, strict=True)
    ]
    poses = [
        np.array([of[image] for image in of_camera]).reshape(-1, 4, 4)
        for of, of_camera in zip(camera_from_target, images, strict=True)
    ]
    clocks: list[int | None] = [0] + [None] * (len(stamps) - 1)
    waiting = [0]
    while waiting:
        settled = waiting.pop(0)
        for other in (number for number, clock in enumerate(clocks) if clock is None):
            difference = clock_offset(
                stamps[settled], poses[settled], stamps[other], poses[other], symmetries, points, tolerance_ns
            )
            if difference is not None:
                clocks[other] = (clocks[settled] or 0) + difference.offset_ns
                waiting.append(other)
    return clocks


def _candidates(a: np.ndarray, b: np.ndarray, tolerance: int) -> list[int]:
    """Differences of the stamps, ns, that many pairs of images share; no two within the tolerance of each other."""
    drawn = np.random.default_rng(0).permutation(a)[: max(_MOST_DIFFERENCES // max(len(b), 1), 1)]
    differences = np.sort(np.subtract.outer(b, drawn).ravel())
    if len(differences) == 0:
        return []
    counts = np.searchsorted(differences, differences + tolerance, side="right") - np.arange(len(differences))
    most = min(counts.max(), min(len(drawn), len(b)))
    chosen: list[int] = []
    for start in np.argsort(-counts, kind="stable"):
        if counts[start] < max(_LEAST_VIEWS, _ENOUGH * most) or len(chosen) == _MOST_CANDIDATES:
            break
        middle = int(np.median(differences[start : start + counts[start]]))
        if all(abs(middle - other) > tolerance for other in chosen):
            chosen.append(middle)
    return [difference for difference in chosen if len(_common(a, b, difference, tolerance)) >= _LEAST_VIEWS]


def _common(a: np.ndarray, b: np.ndarray, offset: int, tolerance: int) -> np.ndarray:
    """Images (m, 2) of the same time."""
    moments = simultaneous([a, b - offset], tolerance)
    return moments[(moments >= 0).all(axis=1)]


def _cost(pair: PairPose, views: int) -> float:
    """Mean square of the disagreement, that of a view which does not agree at all bounded."""
    return (pair.views * pair.disagreement**2 + (views - pair.views) * WORST_DISAGREEMENT**2) / views
