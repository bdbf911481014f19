"""Which moments of a rig's recording to look at: some, evenly spread, then those next to where two cameras saw it.

A moment is one row of an array (m, cameras): the numbers of the images taken at the same time, −1 where there is none.
"""

from __future__ import annotations

import numpy as np


def first_moments(count: int, most: int) -> np.ndarray:
    """Rows to begin with, of ``count``: all where they are not more than ``most``, or else half of ``most``, spread."""
    if count <= most:
        return np.arange(count)
    return np.unique(np.linspace(0, count - 1, max(2, most // 2)).round().astype(int))


def next_moments(looked: np.ndarray, shared: np.ndarray, most: int) -> np.ndarray:
    """Further rows, the nearest to shared ones first, until ``most`` have been looked at; none where none is shared.

    looked, shared (m,) bool: the rows looked at so far, and those of them in which two cameras saw the target.
    """
    left, good = np.flatnonzero(~looked), np.flatnonzero(shared)
    if not (len(left) and len(good)):
        return left[:0]
    distance = np.abs(np.subtract.outer(left, good)).min(axis=1)
    return left[np.argsort(distance, kind="stable")[: max(0, most - int(looked.sum()))]]
