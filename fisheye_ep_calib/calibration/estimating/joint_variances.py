"""The most likely variances of groups that are asked for, of one linearisation (joint_posterior.py).

Steps of variances.py leave out for good what seems to vanish. So every group of the views, and the lens field, starts
from the best of a few sizes, one after the other, on top of the shape's groups.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from fisheye_ep_calib.calibration.estimating.fit import Fit
from fisheye_ep_calib.calibration.estimating.joint_posterior import (
    FIRST_LENS,
    FIRST_VIEW,
    JOINT_GROUPS,
    LENS_GROUPS,
    JointLinearisation,
    JointPosterior,
    linearised_jointly,
)
from fisheye_ep_calib.camera.extras.lens_field import LENS_FIELD
from fisheye_ep_calib.target.shape.model import FIRST_DEVIATIONS, GROUPS, REVIVED_DEVIATION
from fisheye_ep_calib.target.shape.variances import Likelihood, Variances, gains, most_likely

# What an effect moves the points by, in σ, where the search for its τ starts: a τ below the best is better than none.
_TRIED = (1.0, 4.0, 0.1)
_KEPT = "joint_variances"


class JointVariances:
    """Of groups of a linearisation, each set found once.

    near: variances of the shape's groups that are nearly the most likely ones, where they are known. always: groups
    that the fit itself has, and every set with it.
    """

    def __init__(
        self, linearisation: JointLinearisation, near: Variances | None = None, always: tuple[str, ...] = ()
    ) -> None:
        self.linearisation = linearisation
        self._near = near
        self._always = always
        self._found: dict[tuple[str, ...], tuple[Variances, JointPosterior]] = {}
        self._trials: dict[tuple[bytes, float], tuple[Variances, float]] = {}

    @staticmethod
    def index(group: str) -> int:
        """Where a group stands in variances."""
        return JOINT_GROUPS.index(group)

    def most_likely(self, groups: Iterable[str]) -> tuple[Variances, JointPosterior]:
        """The variances of some groups and the posterior under them; groups may vanish. Found once."""
        return self._most_likely({*groups, *self._always})

    def _most_likely(self, groups: set[str]) -> tuple[Variances, JointPosterior]:
        asked = groups & set(self.linearisation.available)
        wanted = tuple(name for name in JOINT_GROUPS if name in asked)
        if wanted not in self._found:
            self._found[wanted] = self._search(wanted)
        return self._found[wanted]

    def without_needless(
        self, variances: Variances, posterior: JointPosterior, groups: Iterable[str], least_gain: float
    ) -> tuple[Variances, JointPosterior]:
        """The most likely variances once those of the groups that gain less than that are left out."""
        needless = (variances.deviation > 0) & (gains(variances, posterior) < least_gain)
        needless &= np.isin(JOINT_GROUPS, list(groups))
        if not needless.any():
            return variances, posterior
        deviation = np.where(needless, 0.0, variances.deviation)
        return self._settled(Variances(deviation, posterior.noise), from_nothing=False)

    def _search(self, wanted: Sequence[str]) -> tuple[Variances, JointPosterior]:
        """From the best of a few τ of each group of the views, and of the lens field, on top of the rest without them.

        Started all at once, what one group explains may be taken by another, and left there; the lens field, which is
        the same in all views, comes before what may differ in each.
        """
        own = [[index for index in map(JOINT_GROUPS.index, wanted) if index >= FIRST_LENS]]
        own += [[index] for index in map(JOINT_GROUPS.index, wanted) if FIRST_VIEW <= index < FIRST_LENS]
        own = [groups for groups in own if groups]
        if not own:
            return self._settled(*self._start(wanted))
        without = self._most_likely({name for name in wanted if name in GROUPS})
        tried, deviance = self._best_start(*without, own)
        if tried is without[0]:
            return without
        deviation, shape = tried.deviation.copy(), [GROUPS.index(name) for name in wanted if name in GROUPS]
        deviation[shape] = np.maximum(
            deviation[shape], REVIVED_DEVIATION
        )  # some may have vanished in what was noise then
        settled = self._settled(replace(tried, deviation=deviation), from_nothing=False)
        return settled if _deviance(settled) <= deviance else self._settled(tried, from_nothing=False)

    def _best_start(
        self, variances: Variances, likelihood: Likelihood, own: Sequence[Sequence[int]]
    ) -> tuple[Variances, float]:
        """What is there, or that with further groups, each at the best of a few τ, and −2 log-likelihood.

        σ falls with every group that is kept: at the first σ, what explains less than that would be missed. So each has
        its likeliest σ.
        """
        best = (variances, likelihood.deviance(variances))
        for groups in own:
            unit = np.array([self.linearisation.effect_of_unit(group) for group in groups])
            trials: list[tuple[Variances, float]] = []
            for size in _TRIED:
                deviation = best[0].deviation.copy()
                deviation[groups] = size * best[0].noise / unit
                trials.append(self._tried(replace(best[0], deviation=deviation)))
                if len(trials) == 2 and trials[1][1] < trials[0][1]:
                    break  # more is better, and so less is not
            best = min((best, *trials), key=lambda trial: trial[1])
        return best

    def _tried(self, variances: Variances) -> tuple[Variances, float]:
        """These τ with the likeliest σ, and −2 log-likelihood of that σ with all τ in proportion, which costs nothing.

        Several searches start from the same.
        """
        key = variances.deviation.tobytes(), variances.noise
        if key not in self._trials:
            likelihood = self.linearisation.likelihood(variances)
            noise = likelihood.noise
            self._trials[key] = replace(variances, noise=noise), likelihood.deviance(variances.at(noise))
        return self._trials[key]

    def _settled(self, start: Variances, from_nothing: bool) -> tuple[Variances, JointPosterior]:
        variances, posterior = most_likely(self.linearisation, start, from_nothing)
        assert isinstance(posterior, JointPosterior)
        return variances, posterior

    def _start(self, groups: Sequence[str]) -> tuple[Variances, bool]:
        """Where the search for the variances of groups of the shape begins, and whether that is a mere guess."""
        deviation = np.zeros(len(JOINT_GROUPS))
        chosen = [GROUPS.index(name) for name in groups]
        if chosen and self._near is not None:
            deviation[chosen] = np.maximum(self._near.deviation[chosen], REVIVED_DEVIATION)
            return Variances(deviation, self._near.noise), False
        deviation[chosen] = FIRST_DEVIATIONS[chosen]
        return Variances(
            deviation, self.linearisation.likelihood(Variances(np.zeros(len(JOINT_GROUPS)), 1.0)).noise
        ), True


def joint_variances(fit: Fit) -> JointVariances:
    """At a fit, whatever of shape, views and lens field it has: all of them free. They are kept with the fit."""
    kept: dict[str, Any] = vars(fit)
    if _KEPT not in kept:
        near = fit.problem.shape.variances
        known = near is not None and near.deviation.any()
        always = LENS_GROUPS if LENS_FIELD.name in fit.structure.extras else ()
        kept[_KEPT] = JointVariances(linearised_jointly(fit), near if known else None, always)
    variances: JointVariances = kept[_KEPT]
    return variances


def _deviance(each: tuple[Variances, Likelihood]) -> float:
    return each[1].deviance(each[0])
