"""Whether the images are of two cameras, or of one whose focus or mount changed in between: by their residuals alone.

Near the fit, a view's residuals ask for a correction δ of the camera. With the view's pose eliminated, s_v the gradient
and S_v the information that it leaves (the blocks of the normal equations, Triggs et al., section 6), one lowers the
cost by

    gain_v(δ) = −s_vᵀ δ − ½ δᵀ S_v δ,        most with δ_v = −S_v⁻¹ s_v

One camera leaves corrections that scatter about zero, by noise, a board that flexes, a lens that is not quite
described. Two leave two, one for each group of images. They are found by turns, as means of two clusters are (Lloyd):
the groups' corrections, then every view's better one. Taken from the group's other views, they explain then nearly all
of what a view asks of fx, fy, cx, cy, which it tells by itself; two corrections never explain that of what scatters (of
a normal distribution on a line 2/π, less in more dimensions, and of V draws of one hardly ever more than
2/π + 0.72/√V), and hardly any view lies between the groups.

A model that fails asks for corrections too: without its pupil, near and far views are as of two cameras. So the groups
must not be told by where the target stood (Mann and Whitney's ranks).
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from fisheye_ep_calib.arrays import FloatArray
from fisheye_ep_calib.calibration.estimating.normal_equations import NormalEquations

PARAMETERS = ("fx", "fy", "cx", "cy")
_LEAST_VIEWS = 8
_LEAST_OF_GROUP = 3
_LEAST_SHARE_OF_VIEWS = 0.15
_SCATTER = 0.72  # over √V: what splitting V normal variables explains beyond 2/π, in one of a hundred sets
_PLACED = 3.0  # σ by which the target stood elsewhere in one group than in the other
_CLEAR = 4.0  # the median view's gain over the other group's correction, in σ²
_RIDGE = 1e-6
_ROUNDS = 50
_STARTS = 24


@dataclass(frozen=True)
class TwoCameras:
    """group (V,) bool: the views of the second camera. corrections (2, 4): of fx, fy, cx, cy, pixels.

    explained: share of what the views ask of these by themselves, beyond noise, that the groups' corrections give.
    clearness: how much better its own group's correction suits the median view than the other's, 2 gain / σ².
    """

    group: np.ndarray
    corrections: np.ndarray
    explained: float
    clearness: float

    @property
    def raised(self) -> bool:
        """Whether the views are of two cameras: groups of a size, that explain it all and leave nothing between."""
        fewest = min(self.group.sum(), (~self.group).sum())
        return bool(
            fewest >= max(_LEAST_OF_GROUP, _LEAST_SHARE_OF_VIEWS * len(self.group))
            and self.explained >= 2 / np.pi + _SCATTER / np.sqrt(len(self.group))
            and self.clearness >= _CLEAR
        )


def two_cameras(
    equations: NormalEquations, names: Sequence[str], residuals: int, middles: np.ndarray
) -> TwoCameras | None:
    """Whether the views of a fit are of two cameras.

    None where there are too few views, fx … cy are not fitted, or the two groups are told by where the target stood.
    names (S,): of the shared parameters. residuals: how many coordinates were measured. middles (V, 3): of the target,
    camera frame, metres.
    """
    if not set(PARAMETERS) <= set(names) or len(equations.by_view) < _LEAST_VIEWS:
        return None
    told = np.array([names.index(name) for name in PARAMETERS])
    score, information = view_scores(equations)
    views = len(score)
    few = information[np.ix_(np.arange(views), told, told)]
    explained = float((score[:, told] * np.linalg.solve(few, score[:, told, None])[..., 0]).sum())
    square = float(equations.by_view[:, -1, -1].sum())
    own = (equations.view_size + len(told)) * views
    variance = (square - explained) / max(residuals - own - len(names), 1)
    split = split_in_two(score, information, told, variance)
    distance = np.linalg.norm(middles, axis=1)
    angle = np.arctan2(np.hypot(middles[:, 0], middles[:, 1]), middles[:, 2])
    if split is None or any(abs(_ranks_apart(by, split.group)) > _PLACED for by in (distance, angle)):
        return None
    return split


def _ranks_apart(values: np.ndarray, group: np.ndarray) -> float:
    """Mann and Whitney's U of two groups (V,) bool, as a standard normal variable: 0 where values (V,) are alike."""
    ranks = np.argsort(np.argsort(values, kind="stable"), kind="stable")
    a, b = int(group.sum()), int((~group).sum())
    if min(a, b) == 0:
        return 0.0
    u = ranks[group].sum() - a * (a - 1) / 2
    return float((u - a * b / 2) / np.sqrt(a * b * (a + b + 1) / 12))


def view_scores(equations: NormalEquations) -> tuple[np.ndarray, np.ndarray]:
    """s_v (V, S) and S_v (V, S, S) of the shared parameters, px², each view's pose eliminated."""
    right = np.concatenate([equations.mixed, equations.pose_gradient[..., None]], axis=2)
    settled = np.linalg.solve(equations.pose, right)
    folded = np.swapaxes(equations.mixed, 1, 2) @ settled
    shared = slice(equations.view_size, -1)
    information = equations.by_view[:, shared, shared] - folded[..., :-1]
    score = equations.shared_gradients - folded[..., -1]
    return score, 0.5 * (information + np.swapaxes(information, 1, 2))


def split_in_two(score: np.ndarray, information: np.ndarray, told: np.ndarray, variance: float) -> TwoCameras | None:
    """The best split of the views in two groups, each with a camera of its own; None for too few views.

    score (V, S), information (V, S, S): of ``view_scores``. told: which of them a view
    tells by itself, for they are well determined: fx, fy, cx, cy. variance: of a residual, px², noise alone.
    """
    views, size = score.shape
    if views < _LEAST_VIEWS:
        return None
    variance = max(variance, 1e-12)
    scale = 1 / np.sqrt(np.maximum(np.diagonal(information.sum(axis=0)), 1e-300))
    score, information = score * scale, information * scale[:, None] * scale + _RIDGE / views * np.eye(size)
    few = np.ix_(np.arange(views), told, told)
    excess = _excess(score[:, told], information[few], variance)
    if excess < 3 * variance * np.sqrt(2 * len(told) * views):
        return TwoCameras(np.zeros(views, bool), np.zeros((2, len(told))), 0.0, 0.0)
    best: tuple[float, np.ndarray, np.ndarray] | None = None
    for start in _starts(score[:, told], information[few]):
        group, _, _ = _settled(score[:, told], information[few], start)
        group, corrections, gain = _settled(score, information, group)
        if best is None or gain > best[0]:
            best = gain, group, corrections
    assert best is not None
    _, group, corrections = best
    left = score + np.einsum("vij,vj->vi", information, _by_the_others(score, information, group))
    explained = 1 - _excess(left[:, told], information[few], variance) / excess
    gains = _gains(score, information, corrections)
    clear = float(np.median(2 * np.abs(gains[1] - gains[0]) / variance))
    return TwoCameras(group, (corrections * scale)[:, told], float(explained), clear)


def _excess(score: np.ndarray, information: np.ndarray, variance: float) -> float:
    """What a correction of its own for every view would lower the cost by, beyond what noise makes of it, px²."""
    most = 0.5 * float((score * np.linalg.solve(information, score[..., None])[..., 0]).sum())
    return most - 0.5 * score.size * variance


def _starts(score: np.ndarray, information: np.ndarray) -> Iterator[np.ndarray]:
    """Groups (V,) to begin with: either side of the middle along each parameter, and along directions between them."""
    own = -np.linalg.solve(information, score[..., None])[..., 0]
    weighted = own * np.sqrt(np.diagonal(information.sum(axis=0)))
    directions = np.concatenate([np.eye(own.shape[1]), np.random.default_rng(0).normal(size=(_STARTS, own.shape[1]))])
    for direction in directions:
        along = weighted @ direction
        yield along > np.median(along)


def _settled(score: np.ndarray, information: np.ndarray, group: np.ndarray) -> tuple[np.ndarray, np.ndarray, float]:
    """Corrections of the groups and groups of the corrections, by turns until nothing changes."""
    corrections = np.zeros((2, score.shape[1]))
    for _ in range(_ROUNDS):
        for which, members in enumerate((~group, group)):
            if members.any():
                corrections[which] = -np.linalg.solve(information[members].sum(axis=0), score[members].sum(axis=0))
        gains = _gains(score, information, corrections)
        following = gains[1] > gains[0]
        if (following == group).all():
            break
        group = following
    return group, corrections.copy(), float(gains.max(axis=0).sum())


def _by_the_others(score: np.ndarray, information: np.ndarray, group: np.ndarray) -> np.ndarray:
    """For each view the correction (V, S) that the other views of its group lead to."""
    result = np.zeros_like(score)
    for members in (~group, group):
        if members.sum() > 1:
            others = information[members].sum(axis=0) - information[members]
            result[members] = -np.linalg.solve(others, (score[members].sum(axis=0) - score[members])[..., None])[..., 0]
    return result


def _gains(score: np.ndarray, information: np.ndarray, corrections: np.ndarray) -> np.ndarray:
    """gain_v(δ) (2, V) of two corrections (2, P)."""
    gain: FloatArray = -corrections @ score.T - 0.5 * np.einsum("ki,vij,kj->kv", corrections, information, corrections)
    return gain
