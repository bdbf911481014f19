"""Variances of restricted maximum likelihood on linear problems whose answer is known."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.optimize import minimize

from fisheye_ep_calib.target.shape.variances import (
    Posterior,
    Variances,
    backward,
    chance_gain,
    gain_over_none,
    most_likely,
)

GROUP = np.repeat([0, 1, 2], [6, 20, 30])
NOISE = 0.2


class LinearProblem:
    """y = F b + J a + e with b free, a of the groups' variances and e of σ = NOISE, and its posterior."""

    def __init__(self, deviation, seed: int) -> None:
        rng = np.random.default_rng(seed)
        self.free, self.shape = rng.normal(0, 1, (400, 8)), rng.normal(0, 1, (400, len(GROUP)))
        self.truth = rng.normal(0, 1, len(GROUP)) * np.array(deviation)[GROUP]
        self.data = self.free @ rng.normal(0, 3, 8) + self.shape @ self.truth + rng.normal(0, NOISE, 400)

    def __call__(self, variances: Variances) -> Posterior:
        there = variances.deviation[GROUP] > 0
        columns = np.concatenate([self.free, self.shape[:, there]], axis=1)
        penalty = np.concatenate([np.zeros(8), variances.penalties[GROUP[there]]])
        matrix = columns.T @ columns + np.diag(penalty)
        inverse = np.linalg.inv(matrix)
        value = inverse @ columns.T @ self.data
        objective = float(self.data @ self.data - value @ matrix @ value)
        log_determinant = float(np.linalg.slogdet(matrix)[1])
        return Posterior(GROUP[there], objective, log_determinant, 400 - 8, value[8:], np.diag(inverse)[8:])

    def deviance(self, variances: Variances) -> float:
        """−2 log of the restricted likelihood from the covariance of the data themselves, up to a constant."""
        prior = np.diag(variances.deviation[GROUP] ** 2)
        covariance = self.shape @ prior @ self.shape.T + variances.noise**2 * np.eye(400)
        inverse = np.linalg.inv(covariance)
        crossed = self.free.T @ inverse @ self.free
        rest = inverse - inverse @ self.free @ np.linalg.inv(crossed) @ self.free.T @ inverse
        return float(np.linalg.slogdet(covariance)[1] + np.linalg.slogdet(crossed)[1] + self.data @ rest @ self.data)


START = Variances(np.full(3, 0.1), 0.1)


def test_the_deviance_is_that_of_the_restricted_likelihood() -> None:
    problem = LinearProblem([0.5, 0.02, 0.0], 0)
    one, other = Variances(np.array([0.4, 0.03, 0.01]), 0.21), Variances(np.array([0.2, 0.01, 0.05]), 0.19)
    found = problem(one).deviance(one) - problem(other).deviance(other)
    assert found == pytest.approx(problem.deviance(one) - problem.deviance(other), rel=1e-8)


@pytest.mark.parametrize("seed", range(4))
def test_the_fixed_point_is_the_maximum_of_the_likelihood(seed) -> None:
    problem = LinearProblem([0.5, 0.03, 0.02], seed)
    found, posterior = most_likely(problem, START)

    def deviance(logarithms: np.ndarray) -> float:
        return problem.deviance(Variances(np.exp(logarithms[:3]), float(np.exp(logarithms[3]))))

    start = np.log([*np.maximum(found.deviation, 1e-3), found.noise])
    best = minimize(deviance, start, method="Nelder-Mead", options={"xatol": 1e-3, "fatol": 1e-4, "maxiter": 2000})
    at_least = problem.deviance(found)
    assert at_least < best.fun + 0.2
    assert found.noise == pytest.approx(NOISE, rel=0.12)
    determined = np.bincount(posterior.group, posterior.determined(found), 3)
    square = np.bincount(posterior.group, posterior.value**2, 3)
    kept = found.deviation > 0
    assert np.sqrt(square / np.maximum(determined, 1e-9))[kept] == pytest.approx(found.deviation[kept], rel=0.06)


def test_a_group_that_is_not_there_vanishes_and_one_that_is_stays() -> None:
    gone, kept_wrongly, lost = 0, 0, 0
    for seed in range(40):
        problem = LinearProblem([0.5, 0.0, 0.0], seed)
        found, posterior = most_likely(problem, START)
        gone += (found.deviation[1:] == 0).sum()
        fewer, _ = backward(problem, found, posterior, 9.5)
        kept_wrongly += (fewer.deviation[1:] > 0).any()
        lost += fewer.deviation[0] == 0
        assert gain_over_none(problem, found, posterior) > 100
    assert gone > 30
    assert kept_wrongly <= 1
    assert lost == 0


def test_what_groups_that_are_not_there_gain_together_by_chance() -> None:
    gains = np.array([_gain(LinearProblem(np.zeros(3), seed)) for seed in range(200)])
    for chance in (0.2, 0.05):
        assert abs((gains > chance_gain(3, chance)).mean() - chance) < 3 * np.sqrt(chance * (1 - chance) / len(gains))


def _gain(problem: LinearProblem) -> float:
    return gain_over_none(problem, *most_likely(problem, START))
