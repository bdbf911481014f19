"""Nothing is known beforehand: neither focal length nor distortion nor pose, and some sightings are wrong."""

from __future__ import annotations

import numpy as np
import pytest
from known_scenes import unknown_scene, with_gross_errors

from fisheye_ep_calib.calibration import calibrate

pytestmark = pytest.mark.filterwarnings("error")
EDGES = [40, 52, 64, 76, 88, 100]
RANDOM = [pytest.param(seed, None, marks=pytest.mark.slow) for seed in range(100)]


def assert_recovered(result, camera, noise: float = 0.1) -> None:
    assert result.converged
    assert result.uncertainty.sigma_px == pytest.approx(noise, rel=0.08)
    assert abs(result.camera.fx / camera.fx - 1) < 0.01
    assert np.hypot(result.camera.cx - camera.cx, result.camera.cy - camera.cy) < 3
    theta = np.linspace(0, 0.9 * result.camera.theta_max, 30)
    # The pupil's reference point may wander along the axis with the poses; its shape may not.
    assert np.abs(result.camera.entrance_pupil(theta) - camera.entrance_pupil(theta)).max() < 1e-3


@pytest.mark.parametrize(("seed", "edge"), [(seed, edge) for seed, edge in enumerate(EDGES)] + RANDOM)
def test_a_camera_of_any_field_is_found(seed, edge) -> None:
    camera, observations = unknown_scene(seed, edge)
    result = calibrate(observations, "ep_even")
    assert_recovered(result, camera)
    assert not result.rejected and result.points == len(observations.pixels)


@pytest.mark.parametrize(("seed", "edge"), [(seed, edge) for seed, edge in enumerate(EDGES)] + RANDOM)
def test_a_tenth_of_gross_errors_is_named_and_harmless(seed, edge) -> None:
    camera, observations = unknown_scene(seed, edge)
    observations, wrong = with_gross_errors(observations, 0.1, seed)
    result = calibrate(observations, "ep_even")
    assert_recovered(result, camera)
    rejected = {(point.view, point.point) for point in result.rejected}
    truth = set(
        zip(observations.image_index[wrong].tolist(), observations.point_index[wrong].tolist(), strict=True)
    )
    assert rejected >= truth and len(rejected) <= len(truth) + 1
    assert result.points == len(observations.pixels) - len(rejected)
    assert result.wrong_views == ()
