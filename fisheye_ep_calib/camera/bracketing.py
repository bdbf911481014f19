"""Roots of functions of one variable, for whole arrays, that cannot leave their bracket."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

_MOST_STEPS = 80


def rising_root(
    function: Callable[[np.ndarray], tuple[np.ndarray, np.ndarray]],
    low: np.ndarray,
    high: np.ndarray,
    start: np.ndarray,
    tolerance: float,
) -> np.ndarray:
    """Where a function rises through zero between low and high: Newton steps, halving where one leaves the bracket.

    function: value and slope at arrays of the shape of start; where its slope is not positive the bracket is halved
    too. Ends once no step exceeds tolerance × (1 + |root|). (Press et al., Numerical Recipes, 9.4.)
    """
    x = start
    for _ in range(_MOST_STEPS):
        value, slope = function(x)
        low, high = np.where(value < 0, x, low), np.where(value < 0, high, x)
        updated = x - value / np.where(slope > 0, slope, 1.0)
        inside = (slope > 0) & (updated >= low) & (updated <= high)
        updated = np.where(inside, updated, 0.5 * (low + high))
        settled = np.abs(updated - x) <= tolerance * (1 + np.abs(updated))
        x = updated
        if settled.all():
            break
    return x


def last_where(holds: Callable[[np.ndarray], np.ndarray], low: np.ndarray, high: np.ndarray) -> np.ndarray:
    """The end of the part of [low, high] in which a condition holds that holds at low and not at high, by halving."""
    for _ in range(60):
        middle = 0.5 * (low + high)
        below = holds(middle)
        low, high = np.where(below, middle, low), np.where(below, high, middle)
    return low
