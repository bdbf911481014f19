"""A ray-traced lens, and cameras calibrated on what it shows."""

from __future__ import annotations

import numpy as np
import pytest

from fisheye_ep_calib.calibration import CalibrationResult, calibrate
from fisheye_ep_calib.camera import FisheyeCamera
from fisheye_ep_calib.simulation import RayTracedCamera, laikin_camera, observe, paper_poses
from fisheye_ep_calib.target.boards.chessboard import Chessboard


@pytest.fixture(scope="session")
def lens() -> RayTracedCamera:
    return laikin_camera()


@pytest.fixture(scope="session")
def calibrated(lens: RayTracedCamera) -> CalibrationResult:
    """From 25 views at 100–150 mm with 0.05 px noise."""
    board = Chessboard.create("board", 11, 7, spacing=0.012)
    return calibrate(observe(lens, board, paper_poses(board), noise=0.05), model="ep_even")


@pytest.fixture(scope="session")
def calibrated_without_pupil(lens: RayTracedCamera) -> FisheyeCamera:
    """The single-viewpoint camera that fits the same views best."""
    board = Chessboard.create("board", 11, 7, spacing=0.012)
    return calibrate(observe(lens, board, paper_poses(board), noise=0.05), model="kannala").camera


@pytest.fixture(scope="session")
def small_camera() -> FisheyeCamera:
    """Every parameter in use, small enough to be quick."""
    return FisheyeCamera(
        image_size=(320, 240),
        fx=90.0,
        fy=91.0,
        cx=161.3,
        cy=118.2,
        skew=0.2,
        radial=(0.01, -0.002, 0.0, 0.0),
        model="ep_even",
        coefficients=(-0.003, -0.0004),
        extras={"tangential": (0.001, -0.002)},
        theta_max=float(np.radians(100)),
    )
