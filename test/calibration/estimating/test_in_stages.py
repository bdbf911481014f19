"""A structure with further terms is reached by way of the usual one: all at once may end in a local minimum."""

from __future__ import annotations

import numpy as np
import pytest
from known_scenes import seen

from fisheye_ep_calib.calibration import calibrate
from fisheye_ep_calib.calibration.estimating.fit import first_fit, refine
from fisheye_ep_calib.calibration.estimating.sightings import prepare
from fisheye_ep_calib.calibration.structure import Structure
from fisheye_ep_calib.simulation import laikin_camera, random_poses
from fisheye_ep_calib.target.boards.chessboard import Chessboard

BOARD = Chessboard.create("board", 11, 7, 0.012)
STRUCTURE = Structure("ep_even", terms=4, lens="kannala_brandt_6")
NOISE = 0.15


@pytest.mark.parametrize("draw", [1, 2, 95])
def test_a_ray_traced_lens_is_fitted_to_its_noise(draw) -> None:
    """Eight close views that end at 0.67 px, r(θ) in the pupil's place, where all terms are free at once."""
    poses = random_poses(BOARD, 8, 95, (0.1, 0.15), (0, 78), (10, 40))
    observations = seen(laikin_camera(), BOARD.object_points, poses, NOISE, draw)
    at_once = refine(first_fit(prepare(observations), STRUCTURE.lens), STRUCTURE)
    result = calibrate(observations, "ep_even", terms=4, lens="kannala_brandt_6")
    assert at_once.rms_px > 0.5
    assert result.rms_px < 1.1 * np.sqrt(2) * NOISE
