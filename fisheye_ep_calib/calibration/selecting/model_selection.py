"""Which structure the data support: cross-validation decides, and the simpler one wins where the gain is in doubt.

Whether there is a pupil at all is another question, which pupil_choice.py and pupil_verdict.py answer.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

from fisheye_ep_calib.calibration.estimating.fit import Fit
from fisheye_ep_calib.calibration.pupil_prior import MODEL, TERMS
from fisheye_ep_calib.calibration.selecting.candidates import (
    FREER,
    SIGNIFICANCE,
    Candidate,
    best_of,
    candidate,
    left_out,
    reason,
    simplest_good,
    supported,
    tested,
    with_addition,
    with_demanded_lens,
    with_model,
    with_needed_lens,
)
from fisheye_ep_calib.calibration.selecting.open_terms import with_open_terms
from fisheye_ep_calib.calibration.selecting.pupil_choice import (
    FURTHER,
    grown,
    is_even,
    pupil_verdict,
    supported_pupils,
)
from fisheye_ep_calib.calibration.selecting.pupil_verdict import PupilVerdict
from fisheye_ep_calib.calibration.structure import FREER_LENS, LENS
from fisheye_ep_calib.camera import PUPIL_FAMILIES
from fisheye_ep_calib.camera.pupils import CENTRAL_MODEL


@dataclass(frozen=True)
class Choice:
    """candidates: one a model, all with the chosen extras; chosen: one of them. reasons: the steps in words.

    verdict: on the pupil. judged: the fit that it is about.
    """

    candidates: dict[str, Candidate]
    chosen: Candidate
    reasons: tuple[str, ...]
    verdict: PupilVerdict
    judged: Fit


@dataclass(frozen=True)
class Search:
    """What ``auto`` may decide: skew, a freer lens, and which of the extras it may add."""

    skew: bool = True
    lens: bool = True
    extras: tuple[str, ...] = ("tangential", "tilt")


def choose(start: Fit, first: Fit, search: Search) -> Choice:
    """Choose among the models, deciding extras first: a lens that bends more would pass for a pupil.

    start: a fit from which others are fitted. first: the fit of what the user has fixed. search: what is open. The
    additions are tried one by one on the model that predicts best, each kept where a nested test and cross-validation
    agree; then all models are compared with what was kept.
    """
    base = first.structure
    fitted = {
        model: Candidate(first) if model == base.model else candidate(start, with_model(base, model, base.terms))
        for model in PUPIL_FAMILIES
    }
    fitted, reasons = with_demanded_lens(fitted) if search.lens else (fitted, [])
    best = best_of(fitted.values())
    structure = best.structure
    best, steps = _with_additions(best, list(search.extras) + [FREER] * (search.lens and structure.lens == LENS))
    reasons += steps
    if search.skew and best.structure.skew:
        without = candidate(best.fit, replace(best.structure, skew=False))
        kept = supported(best, without)
        reasons.append(reason("skew", best, without, kept))
        best = best if kept else without
    if best.structure != structure:
        fitted = {
            model: best
            if model == best.structure.model
            else candidate(fitted[model].fit, with_model(best.structure, model, base.terms))
            for model in PUPIL_FAMILIES
        }
    judged = fitted if search.lens else with_needed_lens(fitted)
    if judged is not fitted:
        reasons.append(f"the pupil is judged with {FREER_LENS}, which the data support: leave the lens open to have it")
    verdict, fit = pupil_verdict(judged, base.terms is None)
    reasons.append(f"entrance pupil {verdict.answer}: {verdict.why}")
    if not verdict.kept:
        return Choice(fitted, fitted[CENTRAL_MODEL], tuple(reasons), verdict, fit)
    others = supported_pupils(judged) if verdict.supported else []
    pupils = sorted({*others, verdict.model}, key=list(fitted).index)
    further = {}
    if base.terms is None:
        further = {name: _with_further_terms(fitted[name]) for name in pupils}
        fitted |= {name: each for name, (each, _) in further.items()}
    chosen = simplest_good(fitted, pupils)
    if chosen.structure.model in further:
        reasons += further[chosen.structure.model][1]
    if base.terms is None and is_even(chosen.structure.model):
        series = with_open_terms(chosen.fit, search.lens)
        if series is not chosen.fit:
            chosen = fitted[MODEL] = Candidate(series)
            reasons.append(
                f"{MODEL} with {TERMS} terms: what data do not tell is left open as far as other lenses have it"
            )
    return Choice(fitted, chosen, tuple(reasons), verdict, fit)


def _with_additions(best: Candidate, additions: list[str]) -> tuple[Candidate, list[str]]:
    """A candidate with what the data support of the additions, one after the other, and the steps in words."""
    reasons = []
    while additions:
        tests = {name: tested(with_addition(best.structure, name), best.fit) for name in additions}
        name, richer = _most_promising(tests)
        if richer is None or not supported(richer, best):
            reasons += [left_out(each, tests[each][0]) for each in additions if each != name]
            reasons += [reason(name, richer, best, False)] if richer else []
            break
        reasons.append(reason(name, richer, best, True))
        best = richer
        additions = [each for each in additions if each != name]
    return best, reasons


def _most_promising(tests: dict[str, tuple[float, Fit | None]]) -> tuple[str, Candidate | None]:
    """Of the additions that pass the nested test the one that predicts best; None where none passes."""
    tried = {name: Candidate(fit) for name, (chance, fit) in tests.items() if fit and chance < SIGNIFICANCE}
    if not tried:
        return "", None
    return min(tried.items(), key=lambda item: item[1].validation.mean_loss)


def _with_further_terms(plain: Candidate) -> tuple[Candidate, list[str]]:
    """A pupil with as many terms as the data support, and the steps."""
    best, reasons = grown(plain.fit)
    if best is plain.fit:
        return plain, reasons
    richer = Candidate(best)
    kept = supported(richer, plain, FURTHER)
    reasons.insert(0, reason(f"{best.structure.pupil_terms} terms of {plain.structure.model}", richer, plain, kept))
    return (richer if kept else plain), reasons
