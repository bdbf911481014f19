"""What the recording could not tell is said, with what to record more of."""

from dataclasses import replace

import numpy as np
import pytest

from fisheye_ep_calib import calibrate
from fisheye_ep_calib.calibration.assessing import near_far
from fisheye_ep_calib.calibration.assessing.camera_difference import camera_difference
from fisheye_ep_calib.simulation import observe, paper_camera, paper_poses, paper_target, random_poses

TARGET = paper_target()


@pytest.fixture(scope="module")
def good():
    """Paper camera, near and far, over the whole field."""
    poses = np.concatenate([paper_poses(TARGET, 0), random_poses(TARGET, 15, 1, distance=(0.2, 0.4))])
    observations = observe(paper_camera(), TARGET, poses, 0.05, 0)
    return {model: calibrate(observations, model) for model in ("ep_odd", "kannala")}


def findings(result):
    return {one.name: one for one in result.diagnosis.findings}


def test_a_good_recording_raises_no_concern_but_the_wrong_model_does(good):
    told = findings(good["ep_odd"])
    assert not told["near_far"].concern
    assert not told["depth"].concern
    assert not told["pupil_against_depth"].concern
    split = findings(good["kannala"])["near_far"]
    assert split.concern
    assert split.values["difference_px"] > 2.5 * split.values["expected_px"]


def test_a_narrow_recording_is_told_to_go_to_the_edge():
    poses = random_poses(TARGET, 12, 2, theta_deg=(0, 45), distance=(0.12, 0.13))
    one_sided = poses[poses[:, 0, 3] > -0.02]
    result = calibrate(observe(paper_camera(), TARGET, one_sided, 0.05, 0), "kannala")
    told = findings(result)
    assert told["depth"].concern
    assert told["coverage"].concern and "left" in told["coverage"].sentence


def test_counts_are_the_sightings_used(good):
    result = good["ep_odd"]
    assert result.diagnosis.counts.sum() == result.points
    assert len(result.diagnosis.view_rms_px) == result.views


def test_a_moved_board_is_the_worst_view():
    observations = observe(paper_camera(), TARGET, paper_poses(TARGET, 0), 0.05, 0)
    shaken = observations.image_index == 7
    noise = np.random.default_rng(0).normal(0, 0.2, (int(shaken.sum()), 2))
    pixels = observations.pixels.copy()
    pixels[shaken] += noise
    told = findings(calibrate(replace(observations, pixels=pixels), "ep_odd"))["worst_view"]
    assert told.concern and observations.image_names[7] in told.sentence


def test_projection_uncertainty_is_smallest_where_the_boards_were(good):
    table = good["ep_odd"].projection_table
    near = int(np.argmin(np.abs(table.distance_m - 0.1)))
    assert (table.sigma_px > 0).all()
    assert (table.sigma_px[:, near] <= table.sigma_px[:, -1] * 1.05).mean() > 0.7


@pytest.mark.parametrize("times", [1.0, 0.1, 200.0])
def test_lengths_in_another_unit_are_told(times):
    """A board 200 times as large stands 26 m away, before a lens whose pupil moves by a foot; a wall may be large."""
    target = replace(TARGET, object_points=TARGET.object_points * times, disc_radius=TARGET.disc_radius * times)
    seen = observe(paper_camera(), TARGET, paper_poses(TARGET, 0), 0.05, 0)
    misread = replace(seen, object_points=target.object_points, disc_radius=target.disc_radius)
    told = findings(calibrate(misread, "ep_even")).get("units")
    assert (told is not None and told.concern) == (times == 200.0)
    if told is not None:
        assert told.values["distance_m"] == pytest.approx(25, abs=5) and "lengths in metres?" in told.sentence
        assert told.values["pupil_mm"] > 50


def test_halves_that_share_no_field_tell_nothing_of_near_and_far(good, monkeypatch):
    fit = good["kannala"].fit
    beyond = camera_difference(fit.state.camera, fit.state.camera, (np.inf,))
    nothing = replace(beyond, **{name: getattr(beyond, name)[:, :0] for name in ("difference_px", "sigma_px")})
    distance = np.linspace(0.1, 0.4, int(fit.used.sum()))
    assert near_far.split_near_far(fit, distance) is not None
    monkeypatch.setattr(near_far, "camera_difference", lambda *_: nothing)
    assert near_far.split_near_far(fit, distance) is None
