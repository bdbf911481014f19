"""What a live calibration is told beside its model: the options of every calibration reach it."""

from __future__ import annotations

import pytest
from bent_boards import seen_bent
from changing_boards import seen_changing
from known_scenes import BOARD, parallel_boards

from fisheye_ep_calib.errors import CalibrationError
from fisheye_ep_calib.live.outcome import calibrate_views
from fisheye_ep_calib.planning.detectability import Board


def calibrated(observations, model, **options):
    outcome = calibrate_views(observations, model, "front", "", Board.of(BOARD), options=options)
    return outcome, outcome.yaml


def test_a_live_calibration_estimates_what_it_is_told_to() -> None:
    observations = seen_changing(flex=2e-4)
    plain, flexed = (calibrated(observations, "ep_even", **given)[0] for given in ({}, {"flex": True}))
    assert flexed.figures["rms_px"] < 0.75 * plain.figures["rms_px"]
    bent, _ = seen_bent("wave", 3e-4)
    flat, free = (calibrated(bent, "ep_even", **given)[0] for given in ({}, {"board_shape": "free"}))
    assert not flat.board.bends and free.board.bent
    assert free.figures["rms_px"] < 0.75 * flat.figures["rms_px"]


def test_a_live_calibration_that_is_refused_can_be_forced() -> None:
    observations = parallel_boards(0.05)
    with pytest.raises(CalibrationError, match="focal length"):
        calibrated(observations, "kannala")
    outcome, text = calibrated(observations, "kannala", force=True)
    assert "refused" in text and outcome.camera.fx > 0
