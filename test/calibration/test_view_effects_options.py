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
    field = tuple(np.random.default_rng(5).normal(0, 1.0, 28) * amount)
    monkeypatch.setattr(changing_boards, "CAMERA", replace(CAMERA, extras={"lens_field": field}))
    result = calibrate(seen_changing(views=16), lens_field=True, board_shape="flat")
    assert ("lens_field" in result.camera.extras) == (amount > 0)
    assert any(reason.startswith("lens_field") for reason in result.reasons)
