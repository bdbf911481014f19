"""Unequal focal lengths are remarked beyond 2 %."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from known_scenes import BOARD, CAMERA

from fisheye_ep_calib import calibrate
from fisheye_ep_calib.calibration.assessing.diagnosis import pixels_not_square
from fisheye_ep_calib.simulation import observe, paper_poses


@pytest.mark.parametrize(("ratio", "raised"), [(1.0, False), (1.019, False), (1.021, True), (0.979, True)])
def test_beyond_two_percent(ratio: float, raised: bool) -> None:
    assert pixels_not_square(replace(CAMERA, fx=ratio * CAMERA.fy)).concern == raised


def test_an_image_that_was_stretched_is_remarked() -> None:
    seen = observe(CAMERA, BOARD, paper_poses(BOARD), noise=0.05)
    width, height = seen.image_size
    stretched = replace(seen, pixels=seen.pixels * np.array([1.0, 0.9]), image_size=(width, round(0.9 * height)))
    result = calibrate(stretched, "ep_even")
    told = {one.name: one for one in result.diagnosis.findings}["pixels_not_square"]
    assert told.concern and told.values["excess"] == pytest.approx(CAMERA.fx / CAMERA.fy / 0.9 - 1, abs=0.003)
    assert "larger than fy" in told.sentence
