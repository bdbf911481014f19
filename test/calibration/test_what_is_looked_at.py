"""A named model is fitted and nothing else; what judges it is worked out when it is looked at."""

from __future__ import annotations

import numpy as np
import pytest
from known_scenes import seen_board, with_gross_errors

from fisheye_ep_calib.calibration import calibrate, result, rough_camera
from fisheye_ep_calib.calibration.selecting import candidates
from fisheye_ep_calib.errors import CalibrationError

JUDGED = {
    "uncertainty": (result, "uncertainty"),
    "stand_in": (result, "single_viewpoint"),
    "comparison": (candidates, "cross_validate"),
    "entrance_pupil_supported": (candidates, "cross_validate"),
    "diagnosis": (result, "diagnose"),
    "projection_table": (result, "projection_table"),
}


class Worked(Exception):
    """Something was worked out."""


def refuse(*_arguments) -> None:
    raise Worked


@pytest.mark.parametrize("model", ["kannala", "ep_odd"])
def test_a_named_model_is_fitted_and_nothing_else(model, monkeypatch) -> None:
    observations = seen_board()
    before = calibrate(observations, model)
    for module, function in set(JUDGED.values()):
        monkeypatch.setattr(module, function, refuse)
    again = calibrate(observations, model)
    assert np.array_equal(again.camera.parameters, before.camera.parameters) and not again.board_warp.any()
    for name in JUDGED:
        with pytest.raises(Worked):
            getattr(again, name)


def test_what_was_looked_at_stays() -> None:
    found = calibrate(seen_board(), "ep_even")
    assert set(found.comparison) == {"kannala", "ep_even"} and found.entrance_pupil_supported
    for name in JUDGED:
        assert getattr(found, name) is getattr(found, name)


def test_a_stand_in_that_was_asked_for_is_refused_at_once() -> None:
    with pytest.raises(CalibrationError, match="svp"):
        calibrate(seen_board(), "ep_even", svp_distance=1e-6)


@pytest.mark.parametrize("model", ["auto", "kannala"])
def test_a_rough_camera_says_where_the_target_is(model) -> None:
    """With a tenth of the points wrong, to a pixel where the judged camera says it, and in the same images."""
    observations, _ = with_gross_errors(seen_board(), 0.1, 1)
    rough, judged = rough_camera(observations, model), calibrate(observations, model)
    assert np.array_equal(rough.view_images, judged.view_images)
    points = observations.object_points
    for pose, other in zip(rough.camera_from_target, judged.camera_from_target, strict=True):
        there, valid = judged.camera.project(points @ other[:3, :3].T + other[:3, 3])
        here, expected = rough.camera.project(points @ pose[:3, :3].T + pose[:3, 3])
        assert np.abs(here - there)[valid & expected].max() < 1.0
        assert (valid & expected).sum() >= valid.sum() - 2
