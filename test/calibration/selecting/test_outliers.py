"""Wrong sightings are named, good ones at the rim are kept."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from known_scenes import CAMERA, rows, seen_board, with_gross_errors

from fisheye_ep_calib.calibration import Observations, calibrate
from fisheye_ep_calib.simulation import observe, paper_camera, paper_poses
from fisheye_ep_calib.target.boards.chessboard import Chessboard

pytestmark = pytest.mark.filterwarnings("error")


@pytest.fixture(scope="module")
def observations() -> Observations:
    return seen_board()


@pytest.mark.parametrize("model", ["auto", "kannala", "ep_even"])
def test_one_wrong_sighting_is_listed_with_view_id_and_residual(observations, model) -> None:
    pixels, row = observations.pixels.copy(), 700
    pixels[row] += [3.0, -4.0]
    result = calibrate(replace(observations, pixels=pixels), model)
    assert len(result.rejected) == 1 and result.points == len(pixels) - 1
    rejected = result.rejected[0]
    assert (rejected.view, rejected.point) == (observations.image_index[row], observations.point_index[row])
    assert rejected.residual == pytest.approx((-3.0, 4.0), abs=0.6)  # predicted minus measured
    clean = calibrate(observations, model)
    assert not clean.rejected and result.camera.fx == pytest.approx(clean.camera.fx, rel=1e-3)


def test_a_small_error_is_noise(observations) -> None:
    pixels = observations.pixels.copy()
    pixels[700] += [0.2, -0.2]
    assert not calibrate(replace(observations, pixels=pixels), "ep_even").rejected


@pytest.mark.parametrize("model", ["kannala", "ep_odd"])
def test_what_a_poor_model_cannot_explain_is_not_wrong(model) -> None:
    """One viewpoint errs by 1.7 px RMS and 10 px at the rim on the paper's camera: every sighting stays."""
    board = Chessboard.create("board", 11, 7, 0.012)
    observations = observe(paper_camera(), board, paper_poses(board), noise=0.05)
    result = calibrate(observations, model)
    assert not result.rejected and result.points == len(observations.pixels)
    if model == "kannala":
        assert result.rms_px > 1.5


@pytest.mark.parametrize("kind", ["shuffled", "anywhere", "mirrored"])
def test_a_view_that_is_wholly_wrong_is_named(observations, kind) -> None:
    own = np.flatnonzero(observations.image_index == 6)
    pixels, rng = observations.pixels.copy(), np.random.default_rng(1)
    if kind == "shuffled":
        pixels[own] = pixels[rng.permutation(own)]
    elif kind == "anywhere":
        pixels[own] = rng.uniform(0, 1199, (len(own), 2))
    else:
        pixels[own, 0] = 1599 - pixels[own, 0]
        pixels[own] += np.array([150.0, 0]) * (observations.point_index[own] % 2)[:, None]
    result = calibrate(replace(observations, pixels=pixels), "ep_even")
    assert result.wrong_views == (6,) and 6 not in result.view_images and result.views == 24
    assert {point.view for point in result.rejected} == {6} and len(result.rejected) == len(own)
    assert result.uncertainty.sigma_px == pytest.approx(0.1, rel=0.06)


def test_two_wrong_views_and_scattered_errors_together(observations) -> None:
    spoiled, wrong = with_gross_errors(observations, 0.05)
    rng, pixels = np.random.default_rng(2), spoiled.pixels.copy()
    for view in (3, 17):
        own = np.flatnonzero(observations.image_index == view)
        pixels[own] = pixels[rng.permutation(own)]
    result = calibrate(replace(spoiled, pixels=pixels))
    assert result.wrong_views == (3, 17)
    named = {(point.view, point.point) for point in result.rejected if point.view not in (3, 17)}
    wrong &= ~np.isin(observations.image_index, (3, 17))
    truth = set(zip(observations.image_index[wrong].tolist(), observations.point_index[wrong].tolist(), strict=True))
    assert named >= truth and len(named) <= len(truth) + 1
    assert result.camera.fx == pytest.approx(CAMERA.fx, rel=2e-3)


def test_too_few_points_for_a_pose_is_not_being_wrong(observations) -> None:
    three = (observations.image_index == 7) & (observations.point_index > 2)
    few = rows(observations, ~three)
    pixels = few.pixels.copy()
    pixels[50] += 30.0
    result = calibrate(replace(few, pixels=pixels), "ep_even")
    assert 7 not in result.view_images and result.wrong_views == () and len(result.rejected) == 1


def test_heavy_tails_cost_few_points(observations) -> None:
    """Real corners have more large errors than a Gaussian; they are not all wrong."""
    noise = 0.1 * np.random.default_rng(3).standard_t(4, observations.pixels.shape)
    truth = seen_board(noise=0.0)
    result = calibrate(replace(truth, pixels=truth.pixels + noise), "ep_even")
    assert len(result.rejected) < 0.01 * len(noise) and not result.wrong_views


@pytest.mark.parametrize(("views", "share"), [(20, 0.05), (8, 0.2)])
def test_the_unit_of_the_weights_does_not_matter(views, share) -> None:
    observations, wrong = with_gross_errors(seen_board(views=views), share)
    one = calibrate(observations, "ep_even")
    assert len(one.rejected) >= wrong.sum()
    for weight in (0.01, 100.0):
        other = calibrate(replace(observations, weights=weight * observations.weights), "ep_even")
        assert {(p.view, p.point) for p in one.rejected} == {(p.view, p.point) for p in other.rejected}
        assert other.camera.fx == pytest.approx(one.camera.fx, rel=1e-6)
        assert other.uncertainty.sigma_px == pytest.approx(weight * one.uncertainty.sigma_px, rel=1e-4)
