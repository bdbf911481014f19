"""Whether an entrance pupil is claimed where there is one, and only there."""

from __future__ import annotations

import re
from dataclasses import replace

import numpy as np
import pytest
from known_scenes import BOARD as BOARD_OF_SCENES
from known_scenes import CAMERA, poses_of, seen, seen_board

from fisheye_ep_calib.calibration import calibrate
from fisheye_ep_calib.calibration.assessing.uncertainty import projection_table
from fisheye_ep_calib.calibration.selecting.pupil_verdict import DOUBTFUL, SUPPORTED
from fisheye_ep_calib.calibration.words import pupil_sentence
from fisheye_ep_calib.camera.bands import pupil_sigma
from fisheye_ep_calib.simulation import observe, paper_camera, paper_poses
from fisheye_ep_calib.target.boards.chessboard import Chessboard

pytestmark = pytest.mark.filterwarnings("error")
BOARD = Chessboard.create("board", 11, 7, 0.012)  # the paper's grid as points: discs take longer and decide alike


def paper_views(shift: float, seed: int, noise: float = 0.15):
    """Views of the paper's camera with its pupil's coefficients times ``shift``."""
    camera = paper_camera()
    camera = replace(camera, coefficients=tuple(shift * value for value in camera.coefficients))
    return observe(camera, BOARD, paper_poses(BOARD, seed), noise, seed)


def test_a_camera_with_one_viewpoint() -> None:
    result = calibrate(paper_views(0.0, 100))
    assert not result.entrance_pupil_supported and result.model == "kannala"


def test_the_papers_camera() -> None:
    """Its pupil moves as no lens's does, E > 0, by so much that it is believed."""
    result = calibrate(paper_views(1.0, 100))
    assert result.entrance_pupil_supported and result.model == "ep_odd"
    assert result.pupil_verdict.answer == SUPPORTED and result.pupil_verdict.ratio > 10
    told = pupil_sentence(result)
    assert "clustered test p = " in told and "mm farther from the scene" in told
    assert "views left out of the fit are predicted " in told and "better than by a single viewpoint" in told


def test_a_lens_pupil_is_told_of_its_rays() -> None:
    """Where E is clearest against its σ: the truth lies within the band that is told."""
    result = calibrate(observe(CAMERA, BOARD, paper_poses(BOARD, 1), 0.1, 1), "ep_even")
    said = re.search(r"rays (\d+)° off the axis enter ([\d.]+) ± ([\d.]+) mm nearer the scene", pupil_sentence(result))
    assert said is not None
    angle, shift, sigma = (float(number) for number in said.groups())
    assert shift == pytest.approx(-1e3 * float(CAMERA.entrance_pupil(np.radians(angle))), abs=4 * sigma)
    assert 0 < sigma < 0.2 * shift and angle <= np.degrees(result.camera.theta_max)


def test_a_two_hundredth_of_the_papers_shift_is_doubtful_and_kept() -> None:
    """E(80°) = 0.06 mm, E(97°) = 0.4 mm: no lens has that sign, but near views tell of far ones better with it."""
    result = calibrate(paper_views(0.005, 100))
    verdict = result.pupil_verdict
    assert verdict.answer == DOUBTFUL and not result.entrance_pupil_supported
    assert verdict.p_value < 1e-6 and verdict.ratio < 10
    assert verdict.other_distances and verdict.kept and result.model != "kannala"
    assert "doubtful" in pupil_sentence(result) and "keeps it" in pupil_sentence(result)


def test_what_is_not_detected_is_left_open_not_zero() -> None:
    """A pupil of E(80°) = −0.07 mm, less than its σ: it is said how large it may be, and what that may cost."""
    camera = replace(paper_camera(), model="ep_even", coefficients=(-0.03e-3, -0.005e-3))
    result = calibrate(observe(camera, BOARD, paper_poses(BOARD, 1), 0.3, 1))
    assert result.model == "kannala" and result.pupil_verdict.answer != SUPPORTED
    left_open = result.camera.pupil_left_open
    assert left_open is not None
    for angle in np.radians([30, 60, 80]):
        assert 0 < abs(left_open.entrance_pupil(angle) - camera.entrance_pupil(angle)) < 3 * left_open.sigma(angle)
    assert left_open.sigma(result.pupil_verdict.theta) >= 0.999 * result.pupil_verdict.sigma
    assert result.stand_in.loss_px[0.1] > 0.05
    central = calibrate(result.observations, "kannala")
    near = projection_table(result.camera, result.uncertainty, result.fit.problem.free).sigma_px[:-1, 0]
    assert near[-2] > projection_table(central.camera, central.uncertainty, central.fit.problem.free).sigma_px[-3, 0]


@pytest.mark.parametrize(("widest", "least", "most"), [(20, 25, 50), (95, 75, 110)])
def test_it_is_judged_where_the_data_are(widest, least, most) -> None:
    """Of boards whose middles are within 20° of the axis, and of some past 90°: the angle at which E shows best."""
    camera = replace(CAMERA, coefficients=(-1e-3, -0.1e-3))
    poses = poses_of(25, 5, widest)
    verdict = calibrate(seen(camera, BOARD_OF_SCENES.object_points, poses), "ep_even").pupil_verdict
    assert least < np.degrees(verdict.theta) < most and verdict.answer == SUPPORTED
    assert verdict.pupil == pytest.approx(float(camera.entrance_pupil(verdict.theta)), abs=4 * verdict.sigma)


@pytest.mark.slow
def test_one_viewpoint_is_mistaken_for_a_pupil_at_most_once_in_twenty() -> None:
    wrong = [seed for seed in range(20) if calibrate(paper_views(0.0, seed)).entrance_pupil_supported]
    assert len(wrong) <= 1


@pytest.mark.slow
def test_the_choice_takes_the_true_family_where_it_shows() -> None:
    models = [calibrate(paper_views(1.0, seed)).model for seed in range(10)]
    assert models.count("ep_odd") >= 9


def test_a_named_model_says_what_the_data_support() -> None:
    for model in ("kannala", "gennery"):
        assert calibrate(paper_views(1.0, 3), model).entrance_pupil_supported
        assert not calibrate(paper_views(0.0, 3), model).entrance_pupil_supported


def test_what_is_open_is_decided_and_what_is_fixed_is_not() -> None:
    free = calibrate(paper_views(1.0, 4))
    assert {"board warp", "tangential"} & {reason.split(" left out")[0].split(" kept")[0] for reason in free.reasons}
    assert any(reason.startswith("skew") for reason in free.reasons)
    fixed = calibrate(paper_views(1.0, 4), board_warp=False, tangential=False, skew=False)
    assert not any(word in reason for reason in fixed.reasons for word in ("tangential", "skew", "board warp"))
    assert fixed.camera.skew == 0 and not fixed.camera.extras and not np.any(fixed.board_warp)
    forced = calibrate(paper_views(1.0, 4), board_warp=True, tangential=True, skew=True)
    assert np.any(forced.board_warp) and "tangential" in forced.camera.extras and forced.camera.skew != 0


@pytest.mark.parametrize("shift", [0.0, 0.5])
def test_a_lens_that_needs_more_terms_is_not_taken_for_a_pupil(shift) -> None:
    """Four terms follow it no better than 0.3 px RMS; E(80°) = 0 and −0.8 mm."""
    camera = replace(paper_camera(), model="ep_even", coefficients=(-0.6e-3 * shift, -0.1e-3 * shift))
    camera = replace(camera, lens="kannala_brandt_6", radial=(*camera.radial, 0.0, 0.0005))
    views = observe(camera, BOARD, paper_poses(BOARD, 1), 0.15, 1)
    found = calibrate(views)
    assert found.camera.lens == "kannala_brandt_6" and not found.rejected and found.rms_px < 0.215
    assert found.entrance_pupil_supported == (shift > 0) == (found.model != "kannala")
    assert len(found.stand_in.camera.radial) == 4
    angle = np.radians(80)
    sigma = pupil_sigma(found.camera, found.uncertainty.covariance, angle)
    assert abs(found.camera.entrance_pupil(angle) - camera.entrance_pupil(angle)) <= 3 * sigma
    for fixed in (calibrate(views, lens="kannala_brandt"), calibrate(views, "ep_even")):
        assert fixed.camera.lens == "kannala_brandt" and fixed.entrance_pupil_supported == (shift > 0)


def test_a_family_is_not_passed_over_for_its_few_terms() -> None:
    """E = a θ² exp(−(θ/1.5)⁶), in four even powers: two of them do worse than four odd ones."""
    theta = np.linspace(0.0, np.radians(100), 200)[1:]
    powers = theta[:, None] ** [2, 4, 6, 8]
    wanted = -0.1 * theta**2 * np.exp(-((theta / 1.5) ** 6))
    coefficients = 0.02 * np.linalg.lstsq(powers, wanted, rcond=None)[0]
    camera = replace(paper_camera(), model="ep_even", coefficients=tuple(coefficients.tolist()))
    result = calibrate(observe(camera, BOARD, paper_poses(BOARD, 1), 0.1, 1))
    assert result.model == "ep_even" and len(result.camera.coefficients) == 4
    angles = np.radians([30, 60, 80])
    sigma = pupil_sigma(result.camera, result.uncertainty.covariance, angles)
    assert (np.abs(result.camera.entrance_pupil(angles) - camera.entrance_pupil(angles)) < 3 * sigma).all()


def test_verdict_and_choice_are_one() -> None:
    camera = replace(CAMERA, model="ep_even", coefficients=(-0.1e-3, 0.0))
    for seed in range(6):
        result = calibrate(seen_board(camera, views=10, seed=seed))
        assert result.entrance_pupil_supported == (result.model != "kannala")


def test_few_views_are_enough_for_a_pupil_that_is_certain() -> None:
    found = [calibrate(seen_board(views=8, seed=seed)) for seed in range(4)]
    assert sum(one.entrance_pupil_supported for one in found) >= 3
