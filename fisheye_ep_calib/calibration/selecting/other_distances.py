"""Whether a model predicts views at other distances than it was fitted to: near ones from far ones, and the reverse.

A pupil and a longer r(θ) look alike at one distance; halves that are drawn by chance share their distances.
"""

from __future__ import annotations

import numpy as np

from fisheye_ep_calib.calibration.estimating.fit import Fit
from fisheye_ep_calib.calibration.selecting.cross_validation import fit_without, held_out_error


def predicts_other_distances(rich: Fit, plain: Fit) -> bool:
    """Whether a fit predicts the farther half of the views from the nearer one, and the reverse, better than another.

    Both must be better: one of the two is by chance half of the time.
    """
    far = _far_half(plain)
    for left_out in (far, ~far):
        try:
            with_pupil, without = (held_out_error(fit_without(fit, left_out), fit, left_out) for fit in (rich, plain))
        except np.linalg.LinAlgError:
            return False
        if not with_pupil[1] < without[1]:
            return False
    return True


def _far_half(fit: Fit) -> np.ndarray:
    """Which views (V,) are the farther half, by the distance of the target's middle."""
    pose = fit.state.camera_from_target
    distance = np.linalg.norm(pose[:, :3, :3] @ fit.problem.features.board.middle + pose[:, :3, 3], axis=1)
    far = np.zeros(len(distance), dtype=bool)
    far[np.argsort(distance, kind="stable")[len(distance) // 2 :]] = True
    return far
