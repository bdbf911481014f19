"""``flex`` and ``rolling_shutter``: the camera that is left when they are estimated."""

from __future__ import annotations

from dataclasses import replace

import changing_boards
import numpy as np
import pytest
from changing_boards import seen_changing
from known_scenes import CAMERA

from fisheye_ep_calib.calibration.calibrate import calibrate
from fisheye_ep_calib.camera.bands import pupil_sigma
from fisheye_ep_calib.camera.extras.lens_field import LENS_FIELD

THETA = np.radians(60)


@pytest.mark.parametrize(
    ("option", "changes"),
    [
        ({"flex": True}, {"flex": 2e-4}),
        ({"flex": True, "board_shape": "free"}, {"flex": 2e-4, "wave": 2e-4}),
        ({"rolling_shutter": True}, {"turn": 2e-3, "shift": 1e-3}),
    ],
)
def test_what_differs_by_view_is_taken_out_of_residuals_and_pupil(option, changes) -> None:
    observations = seen_changing(**changes)
    without, result = (calibrate(observations, "ep_even", **given) for given in ({}, option))
    assert result.converged and result.fit.sigma_px == pytest.approx(0.1, rel=0.08)
    assert result.rms_px < 0.75 * without.rms_px
    sigma = float(pupil_sigma(result.camera, result.uncertainty.covariance, THETA))
    assert sigma < 0.15e-3
    assert abs(result.camera.entrance_pupil(THETA) - CAMERA.entrance_pupil(THETA)) < 2.5 * sigma


def test_where_nothing_differs_nothing_is_estimated() -> None:
    observations = seen_changing()
    result = calibrate(observations, "ep_even", flex=True, rolling_shutter=True)
    assert result.fit.problem.effects is None
    assert result.rms_px == pytest.approx(calibrate(observations, "ep_even").rms_px, rel=1e-6)


@pytest.mark.parametrize("amount", [0.0, 1.0])
def test_auto_takes_a_lens_field_where_there_is_one(amount, monkeypatch) -> None:
    field = tuple(np.random.default_rng(5).normal(0, 1.0, len(LENS_FIELD.coefficient_names)) * amount)
    monkeypatch.setattr(changing_boards, "CAMERA", replace(CAMERA, extras={"lens_field": field}))
    result = calibrate(seen_changing(views=16), lens_field=True, board_shape="flat")
    assert ("lens_field" in result.camera.extras) == (amount > 0)
    assert any(reason.startswith("lens_field") for reason in result.reasons)


@pytest.mark.parametrize("seed", [1, 2])
def test_a_lens_field_does_not_turn_the_axis(seed) -> None:
    """A turned axis looks like a part of a field: with that free the centre was known to 10 px, a stand-in lost 4."""
    result = calibrate(seen_changing(views=16, seed=seed), "ep_even", lens_field=True, board_shape="flat")
    at = [result.camera.parameter_names.index(name) for name in ("cx", "cy")]
    sigma = np.sqrt(np.diag(result.uncertainty.covariance)[at])
    assert sigma.max() < 1.0 and result.iterations < 20
    assert (np.abs([result.camera.cx - CAMERA.cx, result.camera.cy - CAMERA.cy]) < 4 * sigma).all()
    assert result.stand_in.loss_px[10.0] < 1.0


def test_a_shape_that_vanishes_beside_what_changes_is_that_of_the_file() -> None:
    options = {"flex": True, "rolling_shutter": True, "lens_field": True, "board_shape": "free"}
    board = calibrate(seen_changing(views=10, noise=0.2), "ep_even", **options).board
    assert board.kind == "flat" and not board.bends
