"""What turns with the azimuth is told from what does not: from simulated truth."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from known_scenes import CAMERA, seen_board

from fisheye_ep_calib.calibration import Observations
from fisheye_ep_calib.calibration.assessing.asymmetry import not_symmetric
from fisheye_ep_calib.calibration.estimating.fit import Fit, first_fit, refine
from fisheye_ep_calib.calibration.estimating.sightings import prepare
from fisheye_ep_calib.calibration.structure import Structure

pytestmark = pytest.mark.filterwarnings("error")


def fitted(observations: Observations, model: str = "ep_even", **kwargs) -> Fit:
    return refine(first_fit(prepare(observations)), Structure(model, **kwargs))


def test_a_symmetric_camera_is_not_accused() -> None:
    """p below 0.01 for hardly one of 20 sets, and none raised."""
    found = [not_symmetric(fitted(seen_board(seed=seed)))[0] for seed in range(20)]
    assert not any(each.concern for each in found)
    assert sum(each.values["p_value"] < 0.01 for each in found) <= 3


def test_decentring_is_named_and_what_holds_it_silences_the_test() -> None:
    decentred = replace(CAMERA, extras={"tangential": (1e-3, -1e-3)})
    observations = seen_board(decentred)
    (finding,) = not_symmetric(fitted(observations))
    assert finding.concern and "not symmetric about its axis" in finding.sentence
    assert finding.values["effect_px"] > 0.05
    held = not_symmetric(fitted(observations, extras=("tangential",)))
    assert not any(each.concern for each in held)


def test_a_pupil_off_the_axis_is_named() -> None:
    """Its view points move sideways by 0.5 mm towards the rim, which nothing but the distance tells from decentring."""
    observations = seen_board()
    fit = fitted(observations)
    shifted = observations.pixels.copy()
    theta = fit.residuals[1]
    poses = fit.state.camera_from_target[np.searchsorted(fit.sightings.images, observations.image_index)]
    points = np.einsum("nij,nj->ni", poses[:, :3, :3], observations.object_points[observations.point_index])
    points += poses[:, :3, 3]
    moved = points.copy()
    moved[:, 0] += 0.5e-3 * (theta / theta.max()) ** 2
    camera = fit.state.camera
    shifted += camera.project(moved)[0] - camera.project(points)[0]
    inside = ((shifted > 0) & (shifted < np.array(observations.image_size) - 1)).all(axis=1)
    changed = replace(observations, pixels=np.where(inside[:, None], shifted, observations.pixels))
    (finding,) = not_symmetric(fitted(changed))
    assert finding.concern and "pupil off the axis" in finding.sentence
