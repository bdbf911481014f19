"""Which structure the data support: cross-validation decides, and the simpler one wins where the gain is in doubt."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from scipy.special import fdtrc  # the tail of F; scipy.stats would take half a second to load

from fisheye_ep_calib.calibration.adjustment import evaluate
from fisheye_ep_calib.calibration.cross_validation import CrossValidation, cross_validate
from fisheye_ep_calib.calibration.fit import Fit, opened, refine
from fisheye_ep_calib.calibration.normal_equations import solve_damped, view_robust_covariance
from fisheye_ep_calib.calibration.structure import FREER_LENS, LENS, Structure
from fisheye_ep_calib.camera import PUPIL_FAMILIES

_WARP = "board warp"
_FREER = f"lens {FREER_LENS}"
_CLUSTERS_BEYOND_TERMS = 5  # views beyond the number of tested parameters that the view-robust test needs
_ALMOST_UNDAMPED = 1e-9
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
        return self.chosen is not self.candidates["kannala"]


def candidate(start: Fit, structure: Structure) -> Candidate:
    """Fit and cross-validate a structure."""
    fit = refine(start, structure)
    return Candidate(fit, cross_validate(fit))


def nested_test(rich: Fit, plain: Fit) -> float:
    """p-value for "a richer fit's further parameters are zero": the larger of two tests.

    The F test on the costs (Seber and Wild, Nonlinear Regression, 5.3) trusts that residuals are independent; those
    of one view share its pose, its lighting and its blur, so a Wald test whose covariance is built from whole views
    (the cluster-robust sandwich; Cameron and Miller, J. Human Resources 50, 2015) must agree. With too few views for
    that the F test stands alone.
    """
    extra = rich.structure.parameter_count - plain.structure.parameter_count
    if extra <= 0 or rich.degrees_of_freedom <= 0:
        return 1.0
    gain = plain.adjustment.equations.cost - rich.adjustment.equations.cost
    return max(_f_test(plain, gain, extra), _wald_test(rich, plain))


def _f_test(plain: Fit, gain: float, extra: int) -> float:
    """p-value of a gain in cost, px², by ``extra`` parameters more than a fit's."""
    freedom = plain.degrees_of_freedom - extra
    rest = max(plain.adjustment.equations.cost - gain, 1e-300)
    return float(fdtrc(extra, freedom, max(gain, 0.0) / extra / (rest / freedom)))


def first_step_test(structure: Structure, plain: Fit) -> float:
    """As ``nested_test``, from what the first step of a richer structure's adjustment promises: Rao's score test.

    It costs one evaluation where a fit takes several, and says as much where there is little to gain.
    """
    extra = structure.parameter_count - plain.structure.parameter_count
    equations = evaluate(*opened(plain, structure, plain.sightings))
    if extra <= 0 or plain.degrees_of_freedom <= extra:
        return 1.0
    try:
        return _f_test(plain, solve_damped(equations, _ALMOST_UNDAMPED).predicted_decrease, extra)
    except np.linalg.LinAlgError:  # nothing is known about them
        return 1.0


def _wald_test(rich: Fit, plain: Fit) -> float:
    names, values = rich.shared_parameters
    known, _ = plain.shared_parameters
    tested = [i for i, name in enumerate(names) if name not in known]
    views = len(rich.sightings.images)
    if views < len(tested) + _CLUSTERS_BEYOND_TERMS:
        return 0.0
    try:
        covariance = view_robust_covariance(rich.adjustment.equations)[np.ix_(tested, tested)]
        statistic = values[tested] @ np.linalg.lstsq(covariance, values[tested], rcond=None)[0] / len(tested)
    except np.linalg.LinAlgError:  # nothing is known about them
        return 1.0
    return float(fdtrc(len(tested), views - len(tested), statistic)) if np.isfinite(statistic) else 1.0


def supported(rich: Candidate, plain: Candidate, significance: float = _SIGNIFICANCE) -> bool:
    """Whether the data support a richer structure: the nested test must, and it must predict held-out views better.

    How sure the gain is, is the test's matter: folds are few, and a gain may sit in the close-ups of one of them.
    """
    better = rich.validation.mean_loss < plain.validation.mean_loss
    return bool(better and nested_test(rich.fit, plain.fit) < significance)


@dataclass(frozen=True)
class Search:
    """What ``auto`` may decide: skew, a freer lens, and which of the extras and the board warp it may add."""

    skew: bool = True
    lens: bool = True
    extras: tuple[str, ...] = ("tangential",)
    board_warp: bool = True


def choose(start: Fit, base: Structure, search: Search) -> Choice:
    """Choose among the models, deciding extras first: a board's bow, or a lens that bends more, would pass for a pupil.

    base: what the user has fixed; search: what is open. The additions are tried one by one on the model that predicts
    best, each kept where a nested test and cross-validation agree; then all models are compared with what was kept.
    """
    reasons = []
    fitted = {model: candidate(start, _with_model(base, model, base.terms)) for model in PUPIL_FAMILIES}
    best = min(fitted.values(), key=lambda one: one.validation.mean_loss)
    structure = best.structure
    additions = [_WARP] * search.board_warp + list(search.extras) + [_FREER] * search.lens
    while additions:
        name, chance, richer = _most_promising({name: _with_addition(best.structure, name) for name in additions}, best)
        kept = richer is not None and supported(richer, best)
        reasons.append(_reason(name, richer, best, kept) if richer else _left_out(name, chance))
        if not (richer and kept):
            break
        best = richer
        additions.remove(name)
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
        reasons.append(f"the pupil is judged with {FREER_LENS}, which the data support: leave --lens away to have it")
    pupils = supported_pupils(judged)
    grown = {}
    if base.terms is None:
        grown = {name: _with_further_terms(fitted[name]) for name in pupils}
        fitted |= {name: one for name, (one, _) in grown.items()}
    chosen = _simplest_good(fitted, pupils)
    if chosen.structure.model in grown:
        reasons += grown[chosen.structure.model][1]
    return Choice(fitted, chosen, tuple(reasons))


def _most_promising(structures: dict[str, Structure], best: Candidate) -> tuple[str, float, Candidate | None]:
    """Name and p-value of the addition that is tried next, and its candidate where the nested test supports it.

    Of several that pass the test it is the one that predicts best, else the one that comes nearest.
    """
    tests = {name: _tested(structure, best.fit) for name, structure in structures.items()}
    passed = {name: fit for name, (chance, fit) in tests.items() if fit and chance < _SIGNIFICANCE}
    if not passed:
        name = min(tests, key=lambda one: tests[one][0])
        return name, tests[name][0], None
    tried = {name: Candidate(fit, cross_validate(fit)) for name, fit in passed.items()}
    name = min(tried, key=lambda one: tried[one].validation.mean_loss)
    return name, tests[name][0], tried[name]


def _tested(structure: Structure, plain: Fit) -> tuple[float, Fit | None]:
    """p-value of a richer structure and its fit, which is not made where the first step already tells enough."""
    chance = first_step_test(structure, plain)
    if chance > _HOPELESS:
        return chance, None
    fit = refine(plain, structure)
    return nested_test(fit, plain), fit


def _with_further_terms(one: Candidate) -> tuple[Candidate, list[str]]:
    """A pupil with as many terms as the data support; one more may tell little where two more tell much. The steps."""
    reasons = []
    model, best = one.structure.model, one.fit
    for terms in range(one.structure.pupil_terms + 1, PUPIL_FAMILIES[model].max_terms + 1):
        chance, fit = _tested(replace(one.structure, terms=terms), best)
        if fit and chance < _FURTHER:
            best = fit
        else:
            reasons.append(_left_out(f"{terms} terms of {model}", chance))
    if best is one.fit:
        return one, reasons
    richer = Candidate(best, cross_validate(best))
    kept = supported(richer, one, _FURTHER)
    reasons.insert(0, _reason(f"{best.structure.pupil_terms} terms of {model}", richer, one, kept))
    return (richer if kept else one), reasons


def _with_model(structure: Structure, model: str, terms: int | None) -> Structure:
    """The same structure with another pupil, of as many terms as asked for and as that family has."""
    most = PUPIL_FAMILIES[model].max_terms
    return replace(structure, model=model, terms=None if terms is None or most == 0 else min(terms, most))


def _with_addition(structure: Structure, name: str) -> Structure:
    if name == _FREER:
        return replace(structure, lens=FREER_LENS)
    if name == _WARP:
        return replace(structure, board_warp=True)
    return replace(structure, extras=(*structure.extras, name))


def supported_pupils(candidates: dict[str, Candidate]) -> list[str]:
    """Those of the pupil models that the data support against the single viewpoint; each is one of several trials."""
    central = candidates["kannala"]
    pupils = {name: one for name, one in candidates.items() if one is not central}
    return [name for name, one in pupils.items() if supported(one, central, _SIGNIFICANCE / len(pupils))]


def with_needed_lens(candidates: dict[str, Candidate]) -> dict[str, Candidate]:
    """The same models, with a freer r(θ) where the data support it: what four terms leave of one passes for a pupil."""
    best = min(candidates.values(), key=lambda one: one.validation.mean_loss)
    if best.structure.lens != LENS:
        return candidates
    freer = candidate(best.fit, _with_addition(best.structure, _FREER))
    if not supported(freer, best):
        return candidates
    return {
        name: freer if one is best else candidate(one.fit, _with_addition(one.structure, _FREER))
        for name, one in candidates.items()
    }


def _simplest_good(candidates: dict[str, Candidate], pupils: list[str]) -> Candidate:
    """Of the supported pupils the simplest that the best does not clearly beat, ties by prediction.

    Without one that is supported the single viewpoint.
    """
    if not pupils:
        return candidates["kannala"]
    found = [candidates[name] for name in pupils]
    best = min(found, key=lambda one: one.validation.mean_loss)
    good = [one for one in found if one is best or not best.clearly_better(one)]
    return min(good, key=lambda one: (one.structure.parameter_count, one.validation.mean_loss))


def _reason(name: str, richer: Candidate, plain: Candidate, kept: bool) -> str:
    gain, error = richer.validation.log_ratio(plain.validation)
    percent = 100 * (1 - np.exp(gain))
    return (
        f"{name} {'kept' if kept else 'left out'}: held-out error {percent:+.2f} % better ± {100 * error:.2f} %, "
        f"nested test p = {nested_test(richer.fit, plain.fit):.2g}"
    )


def _left_out(name: str, chance: float) -> str:
    return f"{name} left out: nested test p = {chance:.2g}"
