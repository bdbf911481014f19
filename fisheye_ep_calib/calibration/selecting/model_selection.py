"""Which structure the data support: cross-validation decides, and the simpler one wins where the gain is in doubt."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from fisheye_ep_calib.calibration.estimating.fit import Fit, refine
from fisheye_ep_calib.calibration.selecting.cross_validation import CrossValidation, cross_validate
from fisheye_ep_calib.calibration.selecting.nested_tests import first_step_test, nested_test
from fisheye_ep_calib.calibration.structure import FREER_LENS, LENS, Structure
from fisheye_ep_calib.camera import PUPIL_FAMILIES
from fisheye_ep_calib.camera.pupils import CENTRAL_MODEL

_FREER = f"lens {FREER_LENS}"
_HOPELESS = 0.1  # p-value of the first step's test: the fit's own will not be a hundred times smaller
_FURTHER = 0.01  # for further terms of a pupil that is there: one too many costs variance only, not trust
_SIGNIFICANCE = 0.001  # of a nested test; shared by several that ask the same (Bonferroni)


@dataclass(frozen=True)
class Candidate:
    """A fitted and cross-validated structure."""

    fit: Fit
    validation: CrossValidation

    @property
    def structure(self) -> Structure:
        return self.fit.structure

    def clearly_better(self, other: Candidate) -> bool:
        """Whether the gain over another, held out, exceeds its standard error."""
        gain, error = self.validation.log_ratio(other.validation)
        return -gain > error


@dataclass(frozen=True)
class Choice:
    """candidates: one a model, all with the chosen extras; chosen: one of them. reasons: the steps in words."""

    candidates: dict[str, Candidate]
    chosen: Candidate
    reasons: tuple[str, ...]

    @property
    def pupil_supported(self) -> bool:
        return self.chosen is not self.candidates[CENTRAL_MODEL]


def candidate(start: Fit, structure: Structure) -> Candidate:
    """Fit and cross-validate a structure."""
    fit = refine(start, structure)
    return Candidate(fit, cross_validate(fit))


def side_by_side(fit: Fit) -> dict[str, Candidate]:
    """A named model's fit beside the single-viewpoint camera, or that beside an even pupil, everything else alike."""
    own = Candidate(fit, cross_validate(fit))
    other = "ep_even" if fit.structure.model == CENTRAL_MODEL else CENTRAL_MODEL
    beside = candidate(fit, replace(fit.structure, model=other, terms=None, target_axis=False))
    pair = {fit.structure.name: own, other: beside}
    return {CENTRAL_MODEL: pair[CENTRAL_MODEL], **pair}


def supported(rich: Candidate, plain: Candidate, significance: float = _SIGNIFICANCE) -> bool:
    """Whether the data support a richer structure: the nested test must, and it must predict held-out views better.

    How sure the gain is, is the test's matter: folds are few, and a gain may sit in the close-ups of one of them.
    """
    better = rich.validation.mean_loss < plain.validation.mean_loss
    return bool(better and nested_test(rich.fit, plain.fit) < significance)


@dataclass(frozen=True)
class Search:
    """What ``auto`` may decide: skew, a freer lens, and which of the extras it may add."""

    skew: bool = True
    lens: bool = True
    extras: tuple[str, ...] = ("tangential",)


def choose(start: Fit, base: Structure, search: Search) -> Choice:
    """Choose among the models, deciding extras first: a lens that bends more would pass for a pupil.

    base: what the user has fixed; search: what is open. The additions are tried one by one on the model that predicts
    best, each kept where a nested test and cross-validation agree; then all models are compared with what was kept.
    """
    fitted = {model: candidate(start, _with_model(base, model, base.terms)) for model in PUPIL_FAMILIES}
    best = min(fitted.values(), key=lambda each: each.validation.mean_loss)
    structure = best.structure
    best, reasons = _with_additions(best, list(search.extras) + [_FREER] * search.lens)
    if search.skew and best.structure.skew:
        without = candidate(best.fit, replace(best.structure, skew=False))
        kept = supported(best, without)
        reasons.append(_reason("skew", best, without, kept))
        best = best if kept else without
    if best.structure != structure:
        fitted = {
            model: best
            if model == best.structure.model
            else candidate(fitted[model].fit, _with_model(best.structure, model, base.terms))
            for model in PUPIL_FAMILIES
        }
    judged = fitted if search.lens else with_needed_lens(fitted)
    if judged is not fitted:
        reasons.append(f"the pupil is judged with {FREER_LENS}, which the data support: leave the lens open to have it")
    pupils = supported_pupils(judged)
    grown = {}
    if base.terms is None:
        grown = {name: _with_further_terms(fitted[name]) for name in pupils}
        fitted |= {name: each for name, (each, _) in grown.items()}
    chosen = _simplest_good(fitted, pupils)
    if chosen.structure.model in grown:
        reasons += grown[chosen.structure.model][1]
    return Choice(fitted, chosen, tuple(reasons))


def _with_additions(best: Candidate, additions: list[str]) -> tuple[Candidate, list[str]]:
    """A candidate with what the data support of the additions, one after the other, and the steps in words."""
    reasons = []
    while additions:
        tests = {name: _tested(_with_addition(best.structure, name), best.fit) for name in additions}
        name, richer = _most_promising(tests)
        if richer is None or not supported(richer, best):
            reasons += [_left_out(each, tests[each][0]) for each in additions if each != name]
            reasons += [_reason(name, richer, best, False)] if richer else []
            break
        reasons.append(_reason(name, richer, best, True))
        best = richer
        additions = [each for each in additions if each != name]
    return best, reasons


def _most_promising(tests: dict[str, tuple[float, Fit | None]]) -> tuple[str, Candidate | None]:
    """Of the additions that pass the nested test the one that predicts best; None where none passes."""
    tried = {
        name: Candidate(fit, cross_validate(fit))
        for name, (chance, fit) in tests.items()
        if fit and chance < _SIGNIFICANCE
    }
    if not tried:
        return "", None
    return min(tried.items(), key=lambda item: item[1].validation.mean_loss)


def _tested(structure: Structure, plain: Fit) -> tuple[float, Fit | None]:
    """p-value of a richer structure and its fit, which is not made where the first step already tells enough."""
    chance = first_step_test(structure, plain)
    if chance > _HOPELESS:
        return chance, None
    fit = refine(plain, structure)
    return nested_test(fit, plain), fit


def _with_further_terms(plain: Candidate) -> tuple[Candidate, list[str]]:
    """A pupil with as many terms as the data support; one more may tell little where two more tell much. The steps."""
    reasons = []
    model, best = plain.structure.model, plain.fit
    for terms in range(plain.structure.pupil_terms + 1, PUPIL_FAMILIES[model].max_terms + 1):
        chance, fit = _tested(replace(plain.structure, terms=terms), best)
        if fit and chance < _FURTHER:
            best = fit
        else:
            reasons.append(_left_out(f"{terms} terms of {model}", chance))
    if best is plain.fit:
        return plain, reasons
    richer = Candidate(best, cross_validate(best))
    kept = supported(richer, plain, _FURTHER)
    reasons.insert(0, _reason(f"{best.structure.pupil_terms} terms of {model}", richer, plain, kept))
    return (richer if kept else plain), reasons


def _with_model(structure: Structure, model: str, terms: int | None) -> Structure:
    """The same structure with another pupil, of as many terms as asked for and as that family has."""
    most = PUPIL_FAMILIES[model].max_terms
    return replace(structure, model=model, terms=None if terms is None or most == 0 else min(terms, most))


def _with_addition(structure: Structure, name: str) -> Structure:
    if name == _FREER:
        return replace(structure, lens=FREER_LENS)
    return replace(structure, extras=(*structure.extras, name))


def supported_pupils(candidates: dict[str, Candidate]) -> list[str]:
    """Those of the pupil models that the data support against the single viewpoint; each is one of several trials."""
    central = candidates[CENTRAL_MODEL]
    pupils = {name: each for name, each in candidates.items() if each is not central}
    return [name for name, each in pupils.items() if supported(each, central, _SIGNIFICANCE / len(pupils))]


def with_needed_lens(candidates: dict[str, Candidate]) -> dict[str, Candidate]:
    """The same models, with a freer r(θ) where the data support it: what four terms leave of one passes for a pupil."""
    best = min(candidates.values(), key=lambda each: each.validation.mean_loss)
    if best.structure.lens != LENS:
        return candidates
    _, fit = _tested(_with_addition(best.structure, _FREER), best.fit)
    if fit is None:
        return candidates
    freer = Candidate(fit, cross_validate(fit))
    if not supported(freer, best):
        return candidates
    return {
        name: freer if each is best else candidate(each.fit, _with_addition(each.structure, _FREER))
        for name, each in candidates.items()
    }


def _simplest_good(candidates: dict[str, Candidate], pupils: list[str]) -> Candidate:
    """Of the supported pupils the simplest that the best does not clearly beat, ties by prediction.

    Without one that is supported the single viewpoint.
    """
    if not pupils:
        return candidates[CENTRAL_MODEL]
    supported_ones = [candidates[name] for name in pupils]
    best = min(supported_ones, key=lambda each: each.validation.mean_loss)
    good = [each for each in supported_ones if each is best or not best.clearly_better(each)]
    return min(good, key=lambda each: (each.structure.parameter_count, each.validation.mean_loss))


def _reason(name: str, richer: Candidate, plain: Candidate, kept: bool) -> str:
    gain, error = richer.validation.log_ratio(plain.validation)
    percent = 100 * (1 - np.exp(gain))
    return (
        f"{name} {'kept' if kept else 'left out'}: held-out error {percent:+.2f} % better ± {100 * error:.2f} %, "
        f"nested test p = {nested_test(richer.fit, plain.fit):.2g}"
    )


def _left_out(name: str, chance: float) -> str:
    return f"{name} left out: nested test p = {chance:.2g}"
