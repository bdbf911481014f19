"""p-values that mean what they say."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from known_scenes import CAMERA, seen_board

from fisheye_ep_calib.calibration import calibrate
from fisheye_ep_calib.calibration.estimating.fit import refine
from fisheye_ep_calib.calibration.selecting.nested_tests import first_step_test, nested_test
from fisheye_ep_calib.calibration.structure import Structure

CENTRAL = replace(CAMERA, model="kannala", coefficients=())
RICHER = {
    "pupil": Structure("ep_even"),
    "tangential": Structure("kannala", extras=("tangential",)),
    "board warp": Structure("kannala", board_shape="bow"),
    "lens": Structure("kannala", lens="kannala_brandt_6"),
}


@pytest.mark.parametrize("name", RICHER)
def test_without_anything_to_find_every_p_is_as_likely_and_one_step_tells_it(name) -> None:
    found, promised = [], []
    for seed in range(40):
        plain = calibrate(seen_board(CENTRAL, noise=0.2, seed=seed), "kannala").fit
        found.append(nested_test(refine(plain, RICHER[name]), plain))
        promised.append(first_step_test(RICHER[name], plain))
    assert 0.35 < np.mean(promised) < 0.65 and np.min(promised) > 1e-3  # of a uniform p: 0.5 ± 0.05
    assert 0.1 < np.mean(np.array(promised) < 0.25) < 0.45
    # The larger of two tests is the more careful one.
    assert np.mean(found) > np.mean(promised) - 0.01
    assert (np.array(found) > np.array(promised) - 0.05).all()


def test_what_is_there_shows_in_one_step() -> None:
    plain = calibrate(seen_board(noise=0.2), "kannala").fit
    rich = refine(plain, RICHER["pupil"])
    assert nested_test(rich, plain) < 1e-6 and first_step_test(RICHER["pupil"], plain) < 1e-6
    assert nested_test(plain, plain) == first_step_test(plain.structure, plain) == 1.0
