"""Which structure the data support: cross-validation decides, and the simpler one wins where the gain is in doubt.

Whether there is a pupil at all is another question, which pupil_verdict.py answers.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, replace

import numpy as np

from fisheye_ep_calib.calibration.estimating.fit import Fit, refine
from fisheye_ep_calib.calibration.selecting.cross_validation import CrossValidation, cross_validate
from fisheye_ep_calib.calibration.selecting.nested_tests import first_step_test, nested_test
from fisheye_ep_calib.calibration.selecting.other_distances import predicts_other_distances
from fisheye_ep_calib.calibration.selecting.pupil_verdict import DOUBTFUL, PupilVerdict, judge
from fisheye_ep_calib.calibration.structure import FREER_LENS, LENS, Structure
from fisheye_ep_calib.camera import PUPIL_FAMILIES
from fisheye_ep_calib.camera.pupils import CENTRAL_MODEL

_FREER = f"lens {FREER_LENS}"
_HOPELESS = 0.1  # p-value of the first step's test: the fit's own will not be a hundred times smaller
_FURTHER = 0.001  # for further terms of a pupil that is there: one too many costs variance
_FREER_GAIN = 25.0  # of log-likelihood by two more terms of r(θ), beyond which nothing else is asked
_FOLDABLE = 6  # views; with fewer, leaving one out makes the rest extrapolate
_OTHER_FAMILY = 0.001  # chance below which a likelihood ratio prefers a pupil with more terms
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
    """candidates: one a model, all with the chosen extras; chosen: one of them. reasons: the steps in words.

    verdict: on the pupil. judged: the fit that it is about.
    """

    candidates: dict[str, Candidate]
    chosen: Candidate
    reasons: tuple[str, ...]
    verdict: PupilVerdict
    judged: Fit


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


def beside_named(pair: dict[str, Candidate]) -> dict[str, Candidate]:
    """What a named model's pupil is judged among: it may not be of the family that the lens has, so an even one too."""
    judged = with_needed_lens(pair)
    if "ep_even" in judged:
        return judged
    central = judged[CENTRAL_MODEL].fit
    return judged | {"ep_even": candidate(central, replace(central.structure, model="ep_even", terms=None))}


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
    extras: tuple[str, ...] = ("tangential", "tilt")


def choose(start: Fit, base: Structure, search: Search) -> Choice:
    """Choose among the models, deciding extras first: a lens that bends more would pass for a pupil.

    base: what the user has fixed; search: what is open. The additions are tried one by one on the model that predicts
    best, each kept where a nested test and cross-validation agree; then all models are compared with what was kept.
    """
    fitted = {model: candidate(start, _with_model(base, model, base.terms)) for model in PUPIL_FAMILIES}
    fitted, reasons = _with_demanded_lens(fitted) if search.lens else (fitted, [])
    best = best_of(fitted.values())
    structure = best.structure
    best, steps = _with_additions(best, list(search.extras) + [_FREER] * (search.lens and structure.lens == LENS))
    reasons += steps
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
    verdict, fit = pupil_verdict(judged, base.terms is None)
    reasons.append(f"entrance pupil {verdict.answer}: {verdict.why}")
    if not verdict.kept:
        return Choice(fitted, fitted[CENTRAL_MODEL], tuple(reasons), verdict, fit)
    others = supported_pupils(judged) if verdict.supported else []
    pupils = sorted({*others, verdict.model}, key=list(fitted).index)
    grown = {}
    if base.terms is None:
        grown = {name: _with_further_terms(fitted[name]) for name in pupils}
        fitted |= {name: each for name, (each, _) in grown.items()}
    chosen = _simplest_good(fitted, pupils)
    if chosen.structure.model in grown:
        reasons += grown[chosen.structure.model][1]
    return Choice(fitted, chosen, tuple(reasons), verdict, fit)


def best_of(candidates: Iterable[Candidate]) -> Candidate:
    """The one that predicts best; of few views, where held-out ones are extrapolated to, the likeliest (Akaike)."""
    return min(candidates, key=_badness)


def _badness(candidate: Candidate) -> float:
    if len(candidate.fit.sightings.images) >= _FOLDABLE:
        return candidate.validation.mean_loss
    cost = max(candidate.fit.adjustment.equations.cost, 1e-300)
    return float(candidate.fit.degrees_of_freedom * np.log(cost) + 2 * candidate.structure.parameter_count)


def _with_demanded_lens(fitted: dict[str, Candidate]) -> tuple[dict[str, Candidate], list[str]]:
    """The same models with six terms of r(θ) where the likelihood alone demands them: they come before any pupil."""
    best = min(fitted.values(), key=lambda each: each.fit.adjustment.equations.cost)
    if best.structure.lens != LENS:
        return fitted, []
    structure = _with_addition(best.structure, _FREER)
    if first_step_test(structure, best.fit) > _HOPELESS:
        return fitted, []
    freer = refine(best.fit, structure)
    gain = log_likelihood_gain(freer, best.fit)
    if gain < _FREER_GAIN:
        return fitted, []
    return {
        name: Candidate(freer, cross_validate(freer))
        if each is best
        else candidate(each.fit, _with_addition(each.structure, _FREER))
        for name, each in fitted.items()
    }, [f"{_FREER} kept: it gains {gain:.0f} in log-likelihood, over {_FREER_GAIN:g}"]


def log_likelihood_gain(rich: Fit, plain: Fit) -> float:
    """Δ ln L of normal residuals at the richer fit's σ², which its clustering widens."""
    variance = rich.noise_variance[0] * rich.clustering
    return float((plain.adjustment.equations.cost - rich.adjustment.equations.cost) / max(variance, 1e-300))


def pupil_verdict(candidates: dict[str, Candidate], terms_open: bool = True) -> tuple[PupilVerdict, Fit]:
    """The verdict on the pupil, and the fit that it is about.

    It is of the simplest family that no other clearly beats; of an odd one only where an even one sees a pupil too,
    with as many terms as it needs: what an odd one alone sees is r(θ) that bends near the rim. terms_open: whether
    more terms than were asked for may be tried. A doubtful pupil is kept where views at other distances than it was
    fitted to are predicted better with it.
    """
    central = candidates[CENTRAL_MODEL].fit
    pupils = [name for name, each in candidates.items() if each.fit is not central]
    fit = _simplest_good(candidates, pupils).fit
    if terms_open:
        fit, _ = _grown(fit)
    verdict = judge(fit, central)
    if not _is_even(fit.structure.model):
        even, even_fit = _even_verdict(candidates, pupils)
        if not even.supported:
            verdict, fit = even, even_fit
    if verdict.answer != DOUBTFUL:
        return verdict, fit
    better = verdict.views >= _FOLDABLE and predicts_other_distances(fit, central)
    return replace(verdict, other_distances=better, kept=better), fit


def _even_verdict(candidates: dict[str, Candidate], pupils: list[str]) -> tuple[PupilVerdict, Fit]:
    """The verdict on the likeliest even family, which may not have been compared, with as many terms as it needs."""
    central = candidates[CENTRAL_MODEL].fit
    even = [candidates[name].fit for name in pupils if _is_even(candidates[name].structure.model)]
    if not even:
        even = [refine(central, _with_model(central.structure, "ep_even", None))]
    fit, _ = _grown(min(even, key=lambda each: each.adjustment.equations.cost))
    return judge(fit, central), fit


def _is_even(model: str) -> bool:
    """Whether a family of pupils is not an odd one, E(−θ) = −E(θ)."""
    family, theta = PUPIL_FAMILIES[model], np.array([0.3, 0.7])
    terms = family.default_terms
    return not np.allclose(family.basis(-theta, terms), -family.basis(theta, terms), atol=1e-9)


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
    """A pupil with as many terms as the data support, and the steps."""
    best, reasons = _grown(plain.fit)
    if best is plain.fit:
        return plain, reasons
    richer = Candidate(best, cross_validate(best))
    kept = supported(richer, plain, _FURTHER)
    reasons.insert(0, _reason(f"{best.structure.pupil_terms} terms of {plain.structure.model}", richer, plain, kept))
    return (richer if kept else plain), reasons


def _grown(fit: Fit) -> tuple[Fit, list[str]]:
    """A fit with further terms of its pupil, and the steps; one more may tell little where two more tell much."""
    reasons = []
    model, best = fit.structure.model, fit
    for terms in range(fit.structure.pupil_terms + 1, PUPIL_FAMILIES[model].max_terms + 1):
        chance, richer = _tested(replace(fit.structure, terms=terms), best)
        if richer and chance < _FURTHER:
            best = richer
        else:
            reasons.append(_left_out(f"{terms} terms of {model}", chance))
    return best, reasons


def _with_model(structure: Structure, model: str, terms: int | None) -> Structure:
    """The same structure with another pupil, of as many terms as asked for and as that family has."""
    most = PUPIL_FAMILIES[model].max_terms
    return replace(structure, model=model, terms=None if terms is None or most == 0 else min(terms, most))


def _with_addition(structure: Structure, name: str) -> Structure:
    if name == _FREER:
        return replace(structure, lens=FREER_LENS)
    return replace(structure, extras=(*structure.extras, name))


def supported_pupils(candidates: dict[str, Candidate]) -> list[str]:
    """Those of the pupil models that the nested test prefers to the single viewpoint; each is one of several trials."""
    central = candidates[CENTRAL_MODEL]
    pupils = {name: each for name, each in candidates.items() if each is not central}
    return [name for name, each in pupils.items() if nested_test(each.fit, central.fit) < _SIGNIFICANCE / len(pupils)]


def with_needed_lens(candidates: dict[str, Candidate]) -> dict[str, Candidate]:
    """The same models, with a freer r(θ) where the data support it: what four terms leave of one passes for a pupil."""
    demanded, _ = _with_demanded_lens(candidates)
    if demanded is not candidates:
        return demanded
    best = best_of(candidates.values())
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
    """Of the pupils the simplest that the best does not clearly beat, ties by prediction."""
    judged = [candidates[name] for name in pupils]
    best = best_of(judged)
    good = [each for each in judged if each is best or not _clearly_better(best, each)]
    return min(good, key=lambda each: (each.structure.parameter_count, _badness(each)))


def _clearly_better(pupil: Candidate, other: Candidate) -> bool:
    """Whether a pupil predicts better than another, and the likelihood says so too.

    Folds are few: by them alone one in six would be clearly better by chance. The likelihood ratio of families that do
    not contain each other is held to what nested ones with as many terms more would reach by chance.
    """
    if len(pupil.fit.sightings.images) >= _FOLDABLE and not pupil.clearly_better(other):
        return False
    from scipy.special import chdtrc  # scipy.stats would take half a second more to load

    more = max(pupil.structure.parameter_count - other.structure.parameter_count, 1)
    gain = max(log_likelihood_gain(pupil.fit, other.fit), 0.0)
    return bool(chdtrc(more, 2 * gain) < _OTHER_FAMILY)


def _reason(name: str, richer: Candidate, plain: Candidate, kept: bool) -> str:
    gain, error = richer.validation.log_ratio(plain.validation)
    percent = 100 * (1 - np.exp(gain))
    return (
        f"{name} {'kept' if kept else 'left out'}: held-out error {percent:+.2f} % better ± {100 * error:.2f} %, "
        f"nested test p = {nested_test(richer.fit, plain.fit):.2g}"
    )


def _left_out(name: str, chance: float) -> str:
    return f"{name} left out: nested test p = {chance:.2g}"
