"""Whether what one view leaves over is a pattern where the others have noise: something was different in that view.

The columns are those of view_effects.py: a board that bends, one that stretches in its plane, a motion while the
shutter rolls. With the view's normal equations for its pose p and the k columns e, at the fit,

    D = g̃ᵀ (H_ee − H_ep H_pp⁻¹ H_pe)⁺ g̃,   g̃ = g_e − H_ep H_pp⁻¹ g_p,   F = (D / k) / ((|r|² − D) / (2 n − 6 − k))

D being by how much |r|² falls with them (Rao's score test, Math. Proc. Cambridge Phil. Soc. 44, 1948). Corners that
err together do so in all views: F is held against the median one. Where boards bend or shutters roll all along, in one
view more than in another, only what is far beyond the others is told.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from fisheye_ep_calib.calibration.assessing.finding import Finding
from fisheye_ep_calib.calibration.estimating.adjustment import evaluate
from fisheye_ep_calib.calibration.estimating.fit import Fit, opened
from fisheye_ep_calib.calibration.estimating.joint_posterior import seen_points
from fisheye_ep_calib.calibration.estimating.view_effects import FLEX, IN_PLANE, SHUTTER, VIEW_GROUPS, view_effects
from fisheye_ep_calib.calibration.selecting.nested_tests import f_tail

_SIGNIFICANCE = 0.005  # of the largest F of all views
_MOST = 1.5  # F that three in five of the views exceed where most have a pattern
_FAR_BEYOND = 20.0  # times the median F, where they have
_SHARE = 0.5  # of the RMS of the fit: a pattern that is less is not worth a word
_FEWEST_VIEWS = 4  # of which a median says what is usual
_NAMED = 3  # views beside the worst
_TAKEN_UP = 1e-4  # of a direction, relative: what the view's pose leaves of less would take a board bent beyond reason
_CAUSES = {
    "the board bent or was pressed in it": (FLEX,),
    "the board stretched in it, or its corners were found askew": (IN_PLANE,),
    "camera or board moved while its shutter rolled": SHUTTER,
}


@dataclass(frozen=True)
class ViewPattern:
    """Of every view. statistic (V,): F; 0 where the view has too few points. columns (V,): k. freedom (V,).

    moved_px (V,): RMS of the pattern beyond what noise makes of one. cause: what tells it best, of _CAUSES.
    """

    statistic: np.ndarray
    columns: np.ndarray
    freedom: np.ndarray
    moved_px: np.ndarray
    cause: tuple[str, ...]


def structured_views(fit: Fit, names: tuple[str, ...]) -> list[Finding]:
    """The finding; none where it cannot be asked. names: of the images."""
    if fit.problem.effects is not None or fit.structure.target_axis or fit.problem.loss.kind != "linear":
        return []
    if len(fit.sightings.images) < _FEWEST_VIEWS:
        return []
    pattern = view_patterns(fit)
    usual = max(float(np.median(pattern.statistic)), 1.0)
    chances = [
        f_tail(int(columns), int(freedom), each / usual) if each > 0 else 1.0
        for each, columns, freedom in zip(pattern.statistic, pattern.columns, pattern.freedom, strict=True)
    ]
    chance = np.array(chances) * len(chances)
    stands_out = (chance < _SIGNIFICANCE) & (pattern.moved_px >= _SHARE * fit.rms_px / fit.sightings.usual_weight)
    if np.quantile(pattern.statistic, 0.4) > _MOST:
        stands_out &= pattern.statistic >= _FAR_BEYOND * usual
    worst = int(np.argmax(np.where(stands_out | ~stands_out.any(), pattern.moved_px, -1.0)))
    values = {
        "views": float(stands_out.sum()),
        "p_value": float(min(chance.min(), 1.0)),
        "effect_px": float(pattern.moved_px[worst]),
    }
    if not stands_out.any():
        return [Finding("structured_views", values, False, "no view has a pattern in its residuals that others lack")]
    image = int(fit.sightings.images[worst])
    values["image"] = float(image)
    told = (
        f"the points of {names[image]} are off together by {pattern.moved_px[worst]:.2f} px, in a pattern that "
        f"the other views lack{_others(fit, names, stands_out, worst)}: {pattern.cause[worst]}; look at "
        "it, and leave it out or record it again"
    )
    return [Finding("structured_views", values, True, told)]


def _others(fit: Fit, names: tuple[str, ...], stands_out: np.ndarray, worst: int) -> str:
    """The other views that stand out, by name."""
    others = [names[int(fit.sightings.images[view])] for view in np.flatnonzero(stands_out) if view != worst]
    if not others:
        return ""
    return f" (and so are those of {', '.join(others[:_NAMED])}{' and others' * (len(others) > _NAMED)})"


def view_patterns(fit: Fit) -> ViewPattern:
    """F and size of what each view's residuals have of a pattern, camera and target's shape as they are."""
    sightings = fit.sightings
    effects = view_effects(sightings.target, seen_points(sightings), sightings.observations.image_size[1])
    problem, state = opened(fit, fit.structure, replace(sightings, effects=effects))
    by_view, size = evaluate(problem, state, penalised=False).by_view, 6 + effects.size
    groups = {
        cause: np.isin(effects.group, [VIEW_GROUPS.index(name) for name in own]) for cause, own in _CAUSES.items()
    }
    views = len(sightings.images)
    statistic, moved = np.zeros(views), np.zeros(views)
    columns, freedom = np.zeros(views, int), np.zeros(views, int)
    cause = [""] * views
    counts = points_by_view(fit)
    for view in range(views):
        hessian, gradient = by_view[view, :size, :size], by_view[view, :size, -1]
        square, count = float(by_view[view, -1, -1]), int(counts[view])
        gain, columns[view] = _gain(hessian, gradient, np.ones(effects.size, bool))
        freedom[view] = 2 * count - 6 - columns[view]
        if columns[view] == 0 or freedom[view] < columns[view]:
            continue
        noise = max(square - gain, 1e-300) / freedom[view]
        statistic[view] = gain / columns[view] / noise
        moved[view] = np.sqrt(max(gain - columns[view] * noise, 0.0) / count) / sightings.usual_weight
        beyond_noise = {}
        for name, own in groups.items():
            own_gain, own_columns = _gain(hessian, gradient, own)
            beyond_noise[name] = own_gain - own_columns * noise
        cause[view] = max(beyond_noise, key=beyond_noise.__getitem__)
    return ViewPattern(statistic, columns, freedom, moved, tuple(cause))


def _gain(hessian: np.ndarray, gradient: np.ndarray, chosen: np.ndarray) -> tuple[float, int]:
    """D, px², of the chosen (k,) of the columns that follow the pose's six, and how many the pose does not take up."""
    own = 6 + np.flatnonzero(chosen)
    scale = 1 / np.sqrt(np.maximum(np.diag(hessian), 1e-300))
    hessian, gradient = hessian * scale[:, None] * scale, gradient * scale
    taken = np.linalg.lstsq(hessian[:6, :6], np.column_stack([hessian[:6, own], gradient[:6]]), rcond=None)[0]
    reduced = hessian[np.ix_(own, own)] - hessian[own, :6] @ taken[:, :-1]
    right = gradient[own] - hessian[own, :6] @ taken[:, -1]
    values, vectors = np.linalg.eigh((reduced + reduced.T) / 2)
    seen = values > _TAKEN_UP
    return float(((vectors[:, seen].T @ right) ** 2 / values[seen]).sum()), int(seen.sum())


def points_by_view(fit: Fit) -> np.ndarray:
    """Sightings used of each view (V,)."""
    image = fit.sightings.observations.image_index[fit.used]
    return np.bincount(np.searchsorted(fit.sightings.images, image), minlength=len(fit.sightings.images))
