"""Where too few images are views, the refusal tells why the others are none."""

from __future__ import annotations

import numpy as np
import pytest
from known_scenes import BOARD, CAMERA

from fisheye_ep_calib import CalibrationError
from fisheye_ep_calib.pipeline.calibrating import calibrate_cameras
from fisheye_ep_calib.pipeline.camera_source import CameraSource
from fisheye_ep_calib.simulation import observe, paper_poses

UNUSED = {"a": "blurred by about 7 px", "b": "blurred by about 7 px", "c": "board not found"}


def test_a_refusal_for_too_few_views_tells_every_reason() -> None:
    seen = observe(CAMERA, BOARD, paper_poses(BOARD)[:2])
    ((_, end),) = calibrate_cameras([CameraSource("front", seen, unused_views=UNUSED)], None)
    assert isinstance(end, CalibrationError)
    assert str(end).endswith("images not used: 2 ×: blurred by about 7 px, 1 ×: board not found")
    assert "at least 3 are needed" in str(end)


@pytest.mark.parametrize("unused", [{}, UNUSED])
def test_other_refusals_stay_as_they_are(unused: dict[str, str]) -> None:
    seen = observe(CAMERA, BOARD, paper_poses(BOARD)[:5])
    seen.pixels[:] = np.random.default_rng(0).uniform(0, 400, seen.pixels.shape)
    ((_, end),) = calibrate_cameras([CameraSource("front", seen, unused_views=unused)], None, "kannala")
    assert isinstance(end, CalibrationError) and "images not used" not in str(end)
