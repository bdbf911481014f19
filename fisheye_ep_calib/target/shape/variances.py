"""How much a target departs from its file, by group of fields: variances of restricted maximum likelihood.

Coefficients of group g are a priori N(0, τ_g²), residuals N(0, σ²). What has no prior (camera, poses) is integrated out
(Harville, "Maximum likelihood approaches to variance component estimation", J. Am. Stat. Assoc. 72, 1977). With the
information H on all unknowns at one linearisation, the penalty P = diag(σ²/τ²), S = (H + P)⁻¹ and the minimum F of the
squared residuals and the penalty,

    −2 log-likelihood = F/σ² + log|H + P| + ν log σ² − Σ_k log P_kk

for ν residuals less the unknowns without a prior. It is stationary where (MacKay, "Bayesian interpolation", Neural
Computation 4, 1992)

    γ_g = n_g − Σ_{k in g} S_kk P_kk,   τ_g² = |a_g|² / γ_g,   σ² = F / ν

γ_g being the number of coefficients that the data determine. Taken as steps these are sure but slow for a group that
runs towards zero. So after the first ones each group takes the value that is best with the others as they are: what the
data say of coefficient k beside all others is a_k/γ_k, with the variance v_k = σ² S_kk/γ_k and γ_k = 1 − S_kk P_kk, so
that τ² solves Σ_k (τ² + v_k − (a_k/γ_k)²)/(τ² + v_k)² = 0, or is 0 where that sum is positive at 0 (Tipping and Faul,
"Fast marginal likelihood maximisation for sparse Bayesian models", AISTATS 2003; here whole groups at a time).
The same values tell what such a step would gain, were the groups apart; one that gains too little is not taken.
"""

from __future__ import annotations

from collections.abc import Callable, Collection
from dataclasses import dataclass, replace
from functools import cache
from math import comb

import numpy as np

from fisheye_ep_calib.arrays import FloatArray

_MACKAY_STEPS = 2
_MOST_STEPS = 30
_SAME = 0.5  # of −2 log-likelihood, a twentieth of what tells two models apart: a step that gains less is not taken
_LEAST = 2e-8  # metres: what is less is none


@dataclass(frozen=True)
class Variances:
    """deviation (G,): τ of each group, metres; 0 where it is left out. noise: σ of one coordinate, px."""

    deviation: np.ndarray
    noise: float

    @property
    def penalties(self) -> np.ndarray:
        """σ²/τ² (G,), px²/m²; infinite where a group is left out."""
        with np.errstate(divide="ignore"):
            return self.noise**2 / self.deviation**2

    def at(self, noise: float) -> Variances:
        """With another σ and every τ in proportion: penalties, and so the posterior, are the same."""
        return Variances(self.deviation * (noise / self.noise), noise)

    def without(self, group: int) -> Variances:
        deviation = self.deviation.copy()
        deviation[group] = 0.0
        return replace(self, deviation=deviation)


@dataclass(frozen=True)
class Likelihood:
    """Of given variances.

    group (K,): of each coefficient that is there. objective: F, px². log_determinant: of H + P. freedom: ν.
    """

    group: np.ndarray
    objective: float
    log_determinant: float
    freedom: int

    @property
    def noise(self) -> float:
        return float(np.sqrt(max(self.objective, 1e-300) / self.freedom))

    def deviance(self, variances: Variances) -> float:
        """−2 log-likelihood, up to a constant of the data."""
        square = variances.noise**2
        prior = float(np.log(variances.penalties[self.group]).sum())
        return self.objective / square + self.log_determinant + self.freedom * float(np.log(square)) - prior


@dataclass(frozen=True)
class Posterior(Likelihood):
    """The shape under given variances. value (K,): a, metres. variance (K,): S_kk, m²/px²."""

    value: np.ndarray
    variance: np.ndarray

    def determined(self, variances: Variances) -> np.ndarray:
        """γ_k (K,): the share of each coefficient that the data determine."""
        shares: FloatArray = np.clip(1 - self.variance * variances.penalties[self.group], 1e-12, 1.0)
        return shares


PosteriorOf = Callable[[Variances], Posterior]
LikelihoodOf = Callable[[Variances], Likelihood]


def most_likely(posterior_of: PosteriorOf, start: Variances, from_nothing: bool = True) -> tuple[Variances, Posterior]:
    """The variances from a start on, and the posterior under them. A group once left out stays out.

    σ is the likeliest under the penalties, σ² = F / ν: F is the same for all σ and τ in that proportion.
    from_nothing: the start is a mere guess, from which the first steps are MacKay's.
    """
    variances, posterior = start, posterior_of(start)
    for step in range(_MOST_STEPS):
        variances = variances.at(posterior.noise)
        if from_nothing and step < _MACKAY_STEPS:
            updated = _mackay_step(posterior, variances)
        else:
            updated, gain = _group_step(posterior, variances)
            if gain < _SAME:
                break
        variances, posterior = updated, posterior_of(updated)
    return variances.at(posterior.noise), posterior


def _mackay_step(posterior: Posterior, variances: Variances) -> Variances:
    count = len(variances.deviation)
    square = np.bincount(posterior.group, posterior.value**2, count)
    determined = np.bincount(posterior.group, posterior.determined(variances), count)
    return _with(variances, np.sqrt(square / np.maximum(determined, 1e-12)), posterior.noise)


def _group_step(posterior: Posterior, variances: Variances) -> tuple[Variances, float]:
    """Every group's best τ with the others as they are, and by how much −2 log-likelihood falls were they apart."""
    square, doubt = _beside_others(posterior, variances)
    deviation, gain = np.zeros(len(variances.deviation)), 0.0
    for group in np.unique(posterior.group):
        own = posterior.group == group
        before = variances.deviation[group] ** 2
        best = _best_variance(square[own], doubt[own], before)
        deviation[group] = np.sqrt(best)
        gain += _deviance_of(before, square[own], doubt[own]) - _deviance_of(best, square[own], doubt[own])
    return _with(variances, deviation, posterior.noise), gain


def _beside_others(posterior: Posterior, variances: Variances) -> tuple[np.ndarray, np.ndarray]:
    """Squares (K,) of what the data say of each coefficient beside all others, and the variances v (K,) of that."""
    share = posterior.determined(variances)
    return (posterior.value / share) ** 2, variances.noise**2 * posterior.variance / share


def _deviance_of(variance: float, square: np.ndarray, doubt: np.ndarray) -> float:
    """−2 log-likelihood of independent values with these squares (n,), each N(0, τ² + doubt)."""
    whole = variance + doubt
    return float((square / whole + np.log(whole)).sum())


def _best_variance(square: np.ndarray, doubt: np.ndarray, start: float) -> float:
    """τ² ≥ 0 that maximises the likelihood of independent values with these squares (n,), each N(0, τ² + doubt).

    Weighted means of square − doubt with weights (τ² + doubt)⁻², repeated.
    """
    if ((square - doubt) / doubt**2).sum() <= 0:
        return 0.0
    best = start
    for _ in range(50):
        weight = (best + doubt) ** -2
        improved = max(float((weight * (square - doubt)).sum() / weight.sum()), 0.01 * best)
        if abs(improved - best) <= 1e-3 * best:
            return improved
        best = improved
    return best


def _with(variances: Variances, deviation: np.ndarray, noise: float) -> Variances:
    present = (variances.deviation > 0) & (deviation >= _LEAST)
    return Variances(np.where(present, deviation, 0.0), noise)


def none(variances: Variances) -> Variances:
    """No group at all."""
    return replace(variances, deviation=np.zeros_like(variances.deviation))


def gain_over_none(likelihood_of: LikelihoodOf, variances: Variances, posterior: Posterior) -> float:
    """By how much −2 log-likelihood falls with these variances, against a target as its file has it."""
    without = none(variances)
    without = replace(without, noise=likelihood_of(without).noise)
    return likelihood_of(without).deviance(without) - posterior.deviance(variances)


@cache
def chance_gain(groups: int, chance: float) -> float:
    """The gain in −2 log-likelihood that so many groups reach together with this chance where all of their τ are 0.

    At the border of what τ may be each is zero in half of the cases, and else gains a χ² of one degree of freedom: so
    P(gain > g) = Σ_k binomial(G, k) 2^−G P(χ²_k > g) (Self and Liang, J. Am. Stat. Assoc. 82, 1987).
    """
    from scipy.special import chdtrc  # scipy.stats would take half a second more to load

    count = np.arange(1, groups + 1)
    share = np.array([comb(groups, k) / 2**groups for k in count])
    low, high = 0.0, 1e3
    while high - low > 1e-6:
        middle = 0.5 * (low + high)
        low, high = (middle, high) if float(share @ chdtrc(count, middle)) > chance else (low, middle)
    return high


def gains(variances: Variances, posterior: Posterior) -> np.ndarray:
    """By how much −2 log-likelihood falls (G,) with each group's own variance, the others as they are.

    Of values q_k beside all others, each N(0, τ² + v_k) with the group and N(0, v_k) without it (the module's head):
    Σ_k q_k²/v_k − q_k²/(τ² + v_k) − log(1 + τ²/v_k).
    """
    square, doubt = _beside_others(posterior, variances)
    own = variances.deviation[posterior.group] ** 2
    each = square / doubt - square / (own + doubt) - np.log1p(own / doubt)
    return np.bincount(posterior.group, each, len(variances.deviation))


def backward(
    posterior_of: PosteriorOf,
    variances: Variances,
    posterior: Posterior,
    least_gain: float,
    staying: Collection[int] = (),
    likelihood_of: LikelihoodOf | None = None,
) -> tuple[Variances, Posterior]:
    """Groups left out one after the other, the least needed first, while that costs less than least_gain.

    The cost is that of −2 log-likelihood, the other groups' variances most likely again. staying: groups that are not
    left out by that; they may still vanish. likelihood_of: the posterior's likelihood, where that alone costs less.
    """
    while present := [group for group in np.flatnonzero(variances.deviation > 0).tolist() if group not in staying]:
        whole = posterior.deviance(variances)
        costs = [_deviance(likelihood_of or posterior_of, variances.without(group)) - whole for group in present]
        trial = variances.without(present[int(np.argmin(costs))])
        fewer, fewer_posterior = most_likely(posterior_of, trial, from_nothing=False)
        if fewer_posterior.deviance(fewer) - whole >= least_gain:
            break
        variances, posterior = fewer, fewer_posterior
    return variances, posterior


def _deviance(likelihood_of: LikelihoodOf, variances: Variances) -> float:
    return likelihood_of(variances).deviance(variances)
