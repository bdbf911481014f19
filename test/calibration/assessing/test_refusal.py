"""A focal length that is known to less than a twentieth is refused, with what the views lack."""

from __future__ import annotations

import pytest
from known_scenes import parallel_boards

from fisheye_ep_calib.calibration import calibrate
from fisheye_ep_calib.calibration.words import BAD, calibration_verdict
from fisheye_ep_calib.errors import CalibrationError
from fisheye_ep_calib.storage.camera_file import read_camera_file, save_camera


def test_parallel_boards_are_refused_by_name_and_made_all_the_same(tmp_path) -> None:
    observations = parallel_boards(0.05)
    with pytest.raises(CalibrationError, match="focal length.*parallel to the sensor.*tilt.*`force`"):
        calibrate(observations, "kannala")
    result = calibrate(observations, "kannala", force=True)
    assert result.refused is not None and "parallel" in result.refused
    assert calibration_verdict(result).level == BAD
    save_camera(tmp_path / "camera.yaml", result)
    assert read_camera_file(tmp_path / "camera.yaml").calibration["refused"] == result.refused


def test_tilted_boards_are_not() -> None:
    assert calibrate(parallel_boards(0.6), "kannala").refused is None
