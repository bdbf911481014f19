"""Whether a target's estimated shape is kept: views that it was not estimated from must be predicted better with it."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from fisheye_ep_calib.calibration.estimating.fit import Fit, refine
from fisheye_ep_calib.calibration.selecting.cross_validation import cross_validate
from fisheye_ep_calib.target.shape.model import FLAT


def shape_predicts(shaped: Fit) -> tuple[bool, tuple[str, ...]]:
    """Whether folds over views agree that a fit with a free shape predicts better than the same with none, and why.

    They agree where the gain, as mean of ln(RMS ratio) over the folds, exceeds its standard error.
    """
    if not shaped.problem.shape_size:
        return False, ("board shape left out: the data say nothing of one",)
    flat = refine(shaped, replace(shaped.structure, board_shape=FLAT))
    gain, error = cross_validate(shaped).log_ratio(cross_validate(flat))
    kept = -gain > error
    percent = 100 * (1 - np.exp(gain))
    word = "kept" if kept else "left out"
    return kept, (f"board shape {word}: held-out error {percent:+.2f} % better ± {100 * error:.2f} %",)
