"""On which fit the pupil is judged, among which others, and with how many terms.

A pupil and a longer r(θ) look alike at one distance: a doubtful pupil must predict views at other distances.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from fisheye_ep_calib.calibration.estimating.fit import Fit, refine
from fisheye_ep_calib.calibration.selecting.candidates import (
    FOLDABLE,
    SIGNIFICANCE,
    Candidate,
    candidate,
    left_out,
    simplest_good,
    tested,
    with_model,
    with_needed_lens,
)
from fisheye_ep_calib.calibration.selecting.cross_validation import fit_without, held_out_error
from fisheye_ep_calib.calibration.selecting.nested_tests import nested_test
from fisheye_ep_calib.calibration.selecting.pupil_verdict import DOUBTFUL, PupilVerdict, judge
from fisheye_ep_calib.camera import PUPIL_FAMILIES
from fisheye_ep_calib.camera.pupils import CENTRAL_MODEL

FURTHER = 0.001  # for further terms of a pupil that is there: one too many costs variance


def side_by_side(fit: Fit) -> dict[str, Candidate]:
    """A named model's fit beside the single-viewpoint camera, or that beside an even pupil, everything else alike."""
    own = Candidate(fit)
    other = "ep_even" if fit.structure.model == CENTRAL_MODEL else CENTRAL_MODEL
    beside = candidate(fit, replace(fit.structure, model=other, terms=None, target_axis=False))
    pair = {fit.structure.name: own, other: beside}
    return {CENTRAL_MODEL: pair[CENTRAL_MODEL], **pair}


def beside_named(pair: dict[str, Candidate]) -> dict[str, Candidate]:
    """What a named model's pupil is judged among: it may not be of the family that the lens has, so an even one too."""
    judged = with_needed_lens(pair)
    if "ep_even" in judged:
        return judged
    central = judged[CENTRAL_MODEL].fit
    return judged | {"ep_even": candidate(central, replace(central.structure, model="ep_even", terms=None))}


def pupil_verdict(candidates: dict[str, Candidate], terms_open: bool = True) -> tuple[PupilVerdict, Fit]:
    """The verdict on the pupil, and the fit that it is about.

    It is of the simplest family that no other clearly beats; of an odd one only where an even one sees a pupil too,
    with as many terms as it needs: what an odd one alone sees is r(θ) that bends near the rim. terms_open: whether
    more terms than were asked for may be tried. A doubtful pupil is kept where views at other distances than it was
    fitted to are predicted better with it.
    """
    central = candidates[CENTRAL_MODEL].fit
    pupils = [name for name, each in candidates.items() if each.fit is not central]
    fit = simplest_good(candidates, pupils).fit
    if terms_open:
        fit, _ = grown(fit)
    verdict = judge(fit, central)
    if not is_even(fit.structure.model):
        even, even_fit = _even_verdict(candidates, pupils)
        if not even.supported:
            verdict, fit = even, even_fit
    if verdict.answer != DOUBTFUL:
        return verdict, fit
    better = verdict.views >= FOLDABLE and predicts_other_distances(fit, central)
    return replace(verdict, other_distances=better, kept=better), fit


def _even_verdict(candidates: dict[str, Candidate], pupils: list[str]) -> tuple[PupilVerdict, Fit]:
    """The verdict on the likeliest even family, which may not have been compared, with as many terms as it needs."""
    central = candidates[CENTRAL_MODEL].fit
    even = [candidates[name].fit for name in pupils if is_even(candidates[name].structure.model)]
    if not even:
        even = [refine(central, with_model(central.structure, "ep_even", None))]
    fit, _ = grown(min(even, key=lambda each: each.adjustment.equations.cost))
    return judge(fit, central), fit


def is_even(model: str) -> bool:
    """Whether a family of pupils is not an odd one, E(−θ) = −E(θ)."""
    family, theta = PUPIL_FAMILIES[model], np.array([0.3, 0.7])
    terms = family.default_terms
    return not np.allclose(family.basis(-theta, terms), -family.basis(theta, terms), atol=1e-9)


def grown(fit: Fit) -> tuple[Fit, list[str]]:
    """A fit with further terms of its pupil, and the steps; one more may tell little where two more tell much."""
    reasons = []
    model, best = fit.structure.model, fit
    for terms in range(fit.structure.pupil_terms + 1, PUPIL_FAMILIES[model].max_terms + 1):
        chance, richer = tested(replace(fit.structure, terms=terms), best)
        if richer and chance < FURTHER:
            best = richer
        else:
            reasons.append(left_out(f"{terms} terms of {model}", chance))
    return best, reasons


def supported_pupils(candidates: dict[str, Candidate]) -> list[str]:
    """Those of the pupil models that the nested test prefers to the single viewpoint; each is one of several trials."""
    central = candidates[CENTRAL_MODEL]
    pupils = {name: each for name, each in candidates.items() if each is not central}
    return [name for name, each in pupils.items() if nested_test(each.fit, central.fit) < SIGNIFICANCE / len(pupils)]


def predicts_other_distances(rich: Fit, plain: Fit) -> bool:
    """Whether a fit predicts the farther half of the views from the nearer one, and the reverse, better than another.

    Both must be better: one of the two is by chance half of the time.
    """
    far = _far_half(plain)
    for others in (far, ~far):
        try:
            with_pupil, without = (held_out_error(fit_without(fit, others), fit, others) for fit in (rich, plain))
        except np.linalg.LinAlgError:
            return False
        if not with_pupil[1] < without[1]:
            return False
    return True


def _far_half(fit: Fit) -> np.ndarray:
    """Which views (V,) are the farther half, by the distance of the target's middle."""
    pose = fit.state.camera_from_target
    distance = np.linalg.norm(pose[:, :3, :3] @ fit.problem.features.board.middle + pose[:, :3, 3], axis=1)
    far = np.zeros(len(distance), dtype=bool)
    far[np.argsort(distance, kind="stable")[len(distance) // 2 :]] = True
    return far
