"""Fitted and cross-validated structures side by side: which is better, and what the data support of a richer one."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import numpy as np

from fisheye_ep_calib.calibration.estimating.fit import Fit, refine
from fisheye_ep_calib.calibration.estimating.lens_field_estimate import with_lens_field
from fisheye_ep_calib.calibration.selecting.cross_validation import CrossValidation, cross_validate
from fisheye_ep_calib.calibration.selecting.nested_tests import first_step_test, nested_test
from fisheye_ep_calib.calibration.structure import FREER_LENS, LENS, Structure
from fisheye_ep_calib.camera import PUPIL_FAMILIES
from fisheye_ep_calib.camera.extras.lens_field import LENS_FIELD

FREER = f"lens {FREER_LENS}"
_TESTED = "tested_structures"
_HOPELESS = 0.1  # p-value of the first step's test: the fit's own will not be a hundred times smaller
_FREER_GAIN = 25.0  # of log-likelihood by two more terms of r(θ), beyond which nothing else is asked
FOLDABLE = 6  # views; with fewer, leaving one out makes the rest extrapolate
_OTHER_FAMILY = 0.001  # chance below which a likelihood ratio prefers a pupil with more terms
SIGNIFICANCE = 0.001  # of a nested test; shared by several that ask the same (Bonferroni)


@dataclass(frozen=True)
class Candidate:
    """A fitted structure, cross-validated when that is looked at."""

    fit: Fit

    @cached_property
    def validation(self) -> CrossValidation:
        return cross_validate(self.fit)

    @property
    def structure(self) -> Structure:
        return self.fit.structure

    def clearly_better(self, other: Candidate) -> bool:
        """Whether the gain over another, held out, exceeds its standard error."""
        gain, error = self.validation.log_ratio(other.validation)
        return -gain > error


def candidate(start: Fit, structure: Structure) -> Candidate:
    """A structure fitted from where another fit ended."""
    return Candidate(refine(start, structure))


def supported(rich: Candidate, plain: Candidate, significance: float = SIGNIFICANCE) -> bool:
    """Whether the data support a richer structure: the nested test must, and it must predict held-out views better.

    How sure the gain is, is the test's matter: folds are few, and a gain may sit in the close-ups of one of them.
    """
    told = nested_test(rich.fit, plain.fit) < significance
    return bool(told and rich.validation.mean_loss < plain.validation.mean_loss)


def best_of(candidates: Iterable[Candidate]) -> Candidate:
    """The one that predicts best; of few views, where held-out ones are extrapolated to, the likeliest (Akaike)."""
    return min(candidates, key=_badness)


def _badness(candidate: Candidate) -> float:
    if len(candidate.fit.sightings.images) >= FOLDABLE:
        return candidate.validation.mean_loss
    cost = max(candidate.fit.adjustment.equations.cost, 1e-300)
    return float(candidate.fit.degrees_of_freedom * np.log(cost) + 2 * candidate.structure.parameter_count)


def with_demanded_lens(fitted: dict[str, Candidate]) -> tuple[dict[str, Candidate], list[str]]:
    """The same models with six terms of r(θ) where the likelihood alone demands them: they come before any pupil."""
    best = min(fitted.values(), key=lambda each: each.fit.adjustment.equations.cost)
    if best.structure.lens != LENS:
        return fitted, []
    structure = with_addition(best.structure, FREER)
    _, freer = tested(structure, best.fit)
    if freer is None:
        return fitted, []
    gain = log_likelihood_gain(freer, best.fit)
    if gain < _FREER_GAIN:
        return fitted, []
    return {
        name: Candidate(freer) if each is best else candidate(each.fit, with_addition(each.structure, FREER))
        for name, each in fitted.items()
    }, [f"{FREER} kept: it gains {gain:.0f} in log-likelihood, over {_FREER_GAIN:g}"]


def log_likelihood_gain(rich: Fit, plain: Fit) -> float:
    """Δ ln L of normal residuals at the richer fit's σ², which its clustering widens."""
    variance = rich.noise_variance[0] * rich.clustering
    return float((plain.adjustment.equations.cost - rich.adjustment.equations.cost) / max(variance, 1e-300))


def tested(structure: Structure, plain: Fit) -> tuple[float, Fit | None]:
    """p-value of a richer structure and its fit, which is not made where the first step already tells enough.

    It is kept with the plain fit: several questions ask for the same.
    """
    kept: dict[str, Any] = vars(plain)
    tests: dict[Structure, tuple[float, Fit | None]] = kept.setdefault(_TESTED, {})
    if structure not in tests:
        chance, fit = first_step_test(structure, plain), None
        if chance <= _HOPELESS:
            fit = _fitted(plain, structure)
            chance = nested_test(fit, plain)
        tests[structure] = chance, fit
    return tests[structure]


def _fitted(plain: Fit, structure: Structure) -> Fit:
    """A structure fitted from a plainer one; a lens field that the other lacks with its likeliest variances."""
    if LENS_FIELD.name not in structure.extras or LENS_FIELD.name in plain.structure.extras:
        return refine(plain, structure)
    try:
        return with_lens_field(plain)
    except np.linalg.LinAlgError:  # the views leave something open
        return plain


def with_model(structure: Structure, model: str, terms: int | None) -> Structure:
    """The same structure with another pupil, of as many terms as asked for and as that family has."""
    most = PUPIL_FAMILIES[model].max_terms
    return replace(structure, model=model, terms=None if terms is None or most == 0 else min(terms, most))


def with_addition(structure: Structure, name: str) -> Structure:
    if name == FREER:
        return replace(structure, lens=FREER_LENS)
    return replace(structure, extras=(*structure.extras, name))


def with_needed_lens(candidates: dict[str, Candidate]) -> dict[str, Candidate]:
    """The same models, with a freer r(θ) where the data support it: what four terms leave of one passes for a pupil."""
    demanded, _ = with_demanded_lens(candidates)
    if demanded is not candidates:
        return demanded
    best = best_of(candidates.values())
    if best.structure.lens != LENS:
        return candidates
    _, fit = tested(with_addition(best.structure, FREER), best.fit)
    if fit is None:
        return candidates
    freer = Candidate(fit)
    if not supported(freer, best):
        return candidates
    return {
        name: freer if each is best else candidate(each.fit, with_addition(each.structure, FREER))
        for name, each in candidates.items()
    }


def simplest_good(candidates: dict[str, Candidate], pupils: list[str]) -> Candidate:
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
    if len(pupil.fit.sightings.images) >= FOLDABLE and not pupil.clearly_better(other):
        return False
    from scipy.special import chdtrc  # scipy.stats would take half a second more to load

    more = max(pupil.structure.parameter_count - other.structure.parameter_count, 1)
    gain = max(log_likelihood_gain(pupil.fit, other.fit), 0.0)
    return bool(chdtrc(more, 2 * gain) < _OTHER_FAMILY)


def reason(name: str, richer: Candidate, plain: Candidate, kept: bool) -> str:
    gain, error = richer.validation.log_ratio(plain.validation)
    percent = 100 * (1 - np.exp(gain))
    return (
        f"{name} {'kept' if kept else 'left out'}: held-out error {percent:+.2f} % better ± {100 * error:.2f} %, "
        f"nested test p = {nested_test(richer.fit, plain.fit):.2g}"
    )


def left_out(name: str, chance: float) -> str:
    return f"{name} left out: nested test p = {chance:.2g}"
