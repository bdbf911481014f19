"""Levenberg–Marquardt over whatever state gives normal equations."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Generic, TypeVar

import numpy as np

from fisheye_ep_calib.calibration.estimating.normal_equations import NormalEquations, Step, solve_damped

CONVERGED = 1e-10  # predicted decrease of the cost, as a fraction of it
MOST_ITERATIONS = 500  # weak data lead along a long curved valley
CAUTIOUS = 1e-4  # first damping, from a start that may be far off
CONFIDENT = 1e-6  # from a good one: more would slow what the data hold weakly, such as the terms of a pupil
_MOST_DAMPING = 1e14

State = TypeVar("State")
Equations = TypeVar("Equations", bound=NormalEquations)


@dataclass(frozen=True)
class Minimum(Generic[State]):
    """Where the minimisation ended.

    equations: the undamped normal equations there, or where its last step began, but for the cost, which is there.
    """

    state: State
    equations: NormalEquations
    iterations: int
    converged: bool


def minimise(
    evaluate: Callable[[State], Equations],
    stepped: Callable[[State, Step], State | None],
    state: State,
    max_iterations: int = MOST_ITERATIONS,
    tolerance: float = CONVERGED,
    last_step: bool = True,
    first_damping: float = CAUTIOUS,
    unchecked: float = CONVERGED,
    solve: Callable[[Equations, float], Step] = solve_damped,
) -> Minimum[State]:
    """Minimise the cost by Levenberg–Marquardt steps (Nielsen's damping; Madsen et al. 2004, algorithm 3.16).

    stepped: the state after a step, or None where there is none. Converged when the step's predicted decrease falls
    below tolerance × cost. last_step: whether that step is taken as well; where only the cost matters it need not be.
    One that promises less than unchecked × cost is taken without another evaluation: where residuals are nearly linear
    it would only confirm the promise, and below CONVERGED could not tell it from rounding. solve: the damped step.
    """
    equations = evaluate(state)
    damping, growth = first_damping, 4.0
    for iteration in range(max_iterations):
        try:
            step = solve(equations, damping)
        except np.linalg.LinAlgError:
            if damping > _MOST_DAMPING:
                return Minimum(state, equations, iteration + 1, False)
            damping, growth = max(damping, 1e-6) * growth, growth * 2
            continue
        scale = max(equations.cost, 1e-14)
        small = 0 <= step.predicted_decrease <= tolerance * scale
        ends = small and damping < 1.0
        if ends and not last_step:
            return Minimum(state, equations, iteration, True)
        trial = stepped(state, step)
        if ends and trial is not None and step.predicted_decrease <= unchecked * scale:
            promised = replace(equations, cost=max(equations.cost - step.predicted_decrease, 0.0))
            return Minimum(trial, promised, iteration + 1, True)
        trial_equations = evaluate(trial) if trial is not None else None
        accepted = trial_equations is not None and trial_equations.valid and trial_equations.cost < equations.cost
        if accepted and trial is not None and trial_equations is not None:
            gain = (equations.cost - trial_equations.cost) / step.predicted_decrease
            state, equations = trial, trial_equations
            damping *= max(0.05, 1 - (2 * gain - 1) ** 3)
            damping, growth = max(damping, 1e-15), 4.0
        if ends:
            return Minimum(state, equations, iteration + 1, True)
        if not accepted:
            damping, growth = max(damping, 1e-6) * growth, growth * 2
            if damping > _MOST_DAMPING:
                # No downhill step exists beyond rounding: that is a minimum if the last step was small.
                return Minimum(state, equations, iteration + 1, small)
    return Minimum(state, equations, max_iterations, False)
