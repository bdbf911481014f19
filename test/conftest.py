"""Fixtures for every test."""

from __future__ import annotations

import os
from pathlib import Path

import pytest

REPOSITORY = Path(__file__).resolve().parents[1]


@pytest.fixture(scope="session")
def shared_data() -> Path:
    """Folder of real calibration data that is not part of the project; skips where it is absent."""
    folder = Path(os.environ.get("FISHEYE_EP_CALIB_DATA", REPOSITORY.parent / "shared" / "data"))
    if not folder.is_dir():
        pytest.skip(f"no calibration data at {folder}; set FISHEYE_EP_CALIB_DATA to the folder that has it")
    return folder
