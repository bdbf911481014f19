"""One small calibration of a known camera, with wrong points in it, for all tests of reports."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from fisheye_ep_calib import CalibrationResult, Observations, calibrate
from fisheye_ep_calib.errors import InputError
from fisheye_ep_calib.report.data import CameraReport
from fisheye_ep_calib.report.from_calibration import calibration_report
from fisheye_ep_calib.report.html import report_html
from fisheye_ep_calib.simulation import observe, paper_poses
from fisheye_ep_calib.simulation.ray_traced_camera import laikin_camera
from fisheye_ep_calib.target.boards.chessboard import Chessboard

HOSTILE = "<img src=x onerror=alert(1)>\"'&$x^2$"
VIEWS = 12


@pytest.fixture(scope="session")
def observations() -> Observations:
    """Twelve views of a ray-traced lens, 0.05 px of noise, three points moved by 8 px; names that want escaping."""
    board = Chessboard.create("board", 9, 6, spacing=0.014)
    seen = observe(laikin_camera(), board, paper_poses(board)[:VIEWS], noise=0.05)
    pixels = seen.pixels.copy()
    pixels[[5, 100, 300]] += 8.0
    names = tuple(f"{HOSTILE}{name}" for name in seen.image_names)
    return replace(seen, pixels=pixels, image_names=names)


@pytest.fixture(scope="session")
def result(observations: Observations) -> CalibrationResult:
    return calibrate(observations, model="ep_even")


@pytest.fixture(scope="session")
def report(observations: Observations, result: CalibrationResult) -> CameraReport:
    """With a picture of every view but one, which cannot be read."""

    def image(number: int) -> np.ndarray:
        if number == 3:
            raise InputError("damaged")
        width, height = observations.image_size
        return np.random.default_rng(number).integers(0, 255, (height // 4, width // 4), dtype=np.uint8)

    return calibration_report(
        HOSTILE,
        observations,
        result,
        inputs={"source": HOSTILE},
        unused={f"{HOSTILE} unused": "the target was not found"},
        image=image,
    )


@pytest.fixture(scope="session")
def text(report: CameraReport) -> str:
    """The page of two cameras."""
    return report_html([report, replace(report, name="other")])
