"""The findings of boards that bend between views and of motion while the shutter rolls."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from changing_boards import seen_changing

from fisheye_ep_calib.calibration.assessing.view_changes import changes_found, view_changes
from fisheye_ep_calib.calibration.calibrate import calibrate
from fisheye_ep_calib.calibration.estimating.fit import first_fit, refine
from fisheye_ep_calib.calibration.estimating.joint_variances import joint_variances
from fisheye_ep_calib.calibration.estimating.sightings import prepare
from fisheye_ep_calib.calibration.observations import Observations
from fisheye_ep_calib.calibration.structure import Structure
from fisheye_ep_calib.simulation import laikin_camera, paper_poses, paper_target
from fisheye_ep_calib.simulation.truth import points_in_camera

CHANGES = {
    "board_flexes": {"flex": 8e-5, "in_plane": 1e-5},
    "rolling_shutter": {"turn": 1.5e-3, "shift": 5e-4},
}


def findings(**changes) -> dict:
    fit = refine(first_fit(prepare(seen_changing(**changes))), Structure("ep_even"))
    return {each.name: each for each in changes_found(view_changes(joint_variances(fit)))}


@pytest.mark.parametrize("seed", [11, 12])
@pytest.mark.parametrize(("views", "larger"), [(8, 2.0), (20, 1.0)])
@pytest.mark.parametrize("name", CHANGES)
def test_what_changes_is_told_and_nothing_else(name, views, larger, seed) -> None:
    amounts = {kind: larger * amount for kind, amount in CHANGES[name].items()}
    found = findings(**amounts, wave=1e-4, views=views, seed=seed)
    assert [each.name for each in found.values() if each.concern] == [name]


def test_their_words() -> None:
    flexes = findings(**CHANGES["board_flexes"])["board_flexes"]
    assert "the board bent between views" in flexes.sentence and "use a stiff one" in flexes.sentence
    assert flexes.values["flex_mm"] == pytest.approx(0.08, rel=0.3)
    rolls = findings(**CHANGES["rolling_shutter"])["rolling_shutter"]
    assert "moved while the shutter rolled" in rolls.sentence
    assert rolls.values["shift_mm"] == pytest.approx(0.5, rel=0.3)


@pytest.mark.parametrize("wave", [0.0, 2e-4])
@pytest.mark.parametrize("seed", [21, 22, 23])
def test_a_board_that_stays_as_it_is_raises_nothing(wave, seed) -> None:
    found = findings(wave=wave, seed=seed, views=(8, 20)[seed % 2])
    assert not [name for name, each in found.items() if each.concern or each.values["gain"] > 25]


@pytest.mark.parametrize("views", [3, 5])
def test_what_a_model_leaves_in_a_few_views_is_no_change_of_the_board(views) -> None:
    """A lens whose pupil moves, as a camera with one viewpoint sees it."""
    target, camera = paper_target(), laikin_camera()
    poses = paper_poses(target)[:: 25 // views][:views]
    pixels, valid = camera.project(points_in_camera(poses, target.object_points))
    image, point = np.nonzero(valid & ((pixels > 0) & (pixels < np.array(camera.image_size) - 1)).all(axis=-1))
    noisy = pixels[image, point] + np.random.default_rng(1).normal(0, 0.02, (len(image), 2))
    seen = Observations.create(target.object_points, image, point, noisy, camera.image_size)
    found = {each.name: each for each in calibrate(seen, "kannala", force=True).diagnosis.findings}
    for name in (*CHANGES, "not_symmetric"):
        assert not found[name].concern and "fewer than 6 views do not tell" in found[name].sentence


@pytest.mark.parametrize("seed", [1, 2, 3])
def test_a_small_change_in_the_plane_is_no_rolling_shutter(seed) -> None:
    found = findings(in_plane=6e-6, views=20, seed=seed)
    assert [each.name for each in found.values() if each.concern] == ["board_flexes"]


def told(seed: int, shaken: bool = False, **changes) -> dict:
    observations = seen_changing(seed=seed, **changes)
    if shaken:
        rows = observations.image_index == 7
        noise = np.random.default_rng(0).normal(0, 1.5, (int(rows.sum()), 2))
        pixels = observations.pixels.copy()
        pixels[rows] += noise
        observations = replace(observations, pixels=pixels)
    result = calibrate(observations, "ep_even", board_shape="free")
    return {each.name: each.concern for each in result.diagnosis.findings}


@pytest.mark.parametrize("seed", [1, 3])
def test_the_mean_of_what_differs_by_view_is_no_bend(seed) -> None:
    """Of 20 views it is a fifth of what the board does in each, which the shape takes up."""
    flexes, bent_too = told(seed, flex=4e-5), told(seed, flex=4e-5, wave=2e-4)
    assert flexes["board_flexes"] and not flexes["board_bent"]
    assert bent_too["board_flexes"] and bent_too["board_bent"]


def test_a_view_in_which_the_board_bends_more_is_not_the_worst() -> None:
    """Its RMS is 2.6 times the middle view's; that of a shaken one is more than a flex explains."""
    assert not told(1, flex=2e-4)["worst_view"]
    assert told(1, flex=2e-4, shaken=True)["worst_view"]
