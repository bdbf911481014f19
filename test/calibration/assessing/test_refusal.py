"""A focal length that is known to less than a twentieth is refused, with what the views lack."""

from __future__ import annotations

import numpy as np
import pytest
from known_scenes import BOARD, CAMERA, seen

from fisheye_ep_calib.calibration import calibrate
from fisheye_ep_calib.calibration.words import BAD, calibration_verdict
from fisheye_ep_calib.errors import CalibrationError
from fisheye_ep_calib.storage.camera_file import read_camera_file, save_camera


def parallel_boards(tilt: float):
    """Twelve boards at one distance whose normals lie within a tilt, rad, of the axis."""
    rng = np.random.default_rng(4)
    poses = np.tile(np.eye(4), (12, 1, 1))
    for pose in poses:
        x, y = rng.uniform(-tilt, tilt, 2)
        turn = np.array([[1, 0, y], [0, 1, x], [-y, -x, 1]])
        pose[:3, :3] = np.linalg.qr(turn)[0] * np.sign(np.diag(np.linalg.qr(turn)[1]))
        pose[:3, 3] = [rng.uniform(-0.2, 0.05), rng.uniform(-0.12, 0.02), 0.25]
    return seen(CAMERA, BOARD.object_points, poses)


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
