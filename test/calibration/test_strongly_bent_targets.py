"""Target files with a measured shape, strongly bent: they start from nothing as well as flat ones."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from bent_boards import bent
from known_scenes import CAMERA, seen
from registered_targets import named_target

from fisheye_ep_calib import calibrate, evaluate
from fisheye_ep_calib.simulation import observe, random_poses
from fisheye_ep_calib.target.registry import TARGETS
from fisheye_ep_calib.target.shape.measured import BoardShape

SAG = 0.01  # of the board's longer side: 5 mm in 500


@pytest.mark.parametrize("kind", TARGETS)
def test_a_strongly_bent_board_of_known_shape_starts_from_nothing(kind) -> None:
    target, _ = named_target(kind)
    nominal = target.object_points
    size = float(np.ptp(nominal, axis=0).max())
    true = bent(nominal, "bow", SAG * size)
    poses = random_poses(target, 14, 3, (0.8 * size, 2.5 * size), (0.0, 75.0), (5.0, 50.0))
    if target.disc_radius is None:
        observations = seen(CAMERA, true, poses)
    else:
        observations = observe(CAMERA, replace(target, object_points=true), poses, 0.1)
    known = replace(observations, object_points=nominal, board=BoardShape("free", nominal, true - nominal))
    result = calibrate(known, "ep_even")
    assert result.converged and result.rms_px < 0.16
    assert not result.rejected and not result.wrong_views
    theta = np.linspace(0, 0.9 * result.camera.theta_max, 20)
    assert np.abs(result.camera.radius(theta) * result.camera.fx - CAMERA.radius(theta) * CAMERA.fx).max() < 1.0
    assert evaluate(result.camera, known).rms_px < 0.16
