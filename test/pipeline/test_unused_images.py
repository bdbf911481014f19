"""Where too few images are views, the refusal tells why the others are none."""

from __future__ import annotations

import numpy as np
import pytest
from known_scenes import BOARD, CAMERA

from fisheye_ep_calib import CalibrationError, Observations
from fisheye_ep_calib.pipeline.calibrating import calibrate_cameras
from fisheye_ep_calib.pipeline.camera_source import CameraSource
from fisheye_ep_calib.simulation import observe, paper_poses
from fisheye_ep_calib.target.base import rectangular_grid

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


def test_a_refusal_names_a_board_that_is_smaller_than_its_file() -> None:
    """A board of 7 × 5 is laid onto its file's 9 × 6 here and there."""
    file, index = rectangular_grid(9, 6, 0.02, 0.02), np.arange(54).reshape(6, 9)
    parts = [index[y : y + 5, x : x + 7].ravel() for x, y in [(0, 0), (1, 1), (2, 0), (0, 1), (1, 0)]]
    seen = Observations.create(
        object_points=file,
        image_index=np.repeat(np.arange(5), 35),
        point_index=np.concatenate(parts),
        pixels=np.random.default_rng(0).uniform(0, 400, (175, 2)),
        image_size=(400, 400),
        image_names=[f"{number}.png" for number in range(5)],
    )
    ((_, end),) = calibrate_cameras([CameraSource("front", seen)], None, "kannala")
    assert isinstance(end, CalibrationError)
    assert "no view shows more than 7 × 5 of the target file's 9 × 6 points" in str(end)
