"""The commands as a user calls them, in this process where nothing of a process is tested."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from known_scenes import seen_board
from small_recording import write_small_recording

from fisheye_ep_calib.cli import main
from fisheye_ep_calib.storage.observation_file import save_observations


@pytest.fixture(scope="session")
def observation_file(tmp_path_factory) -> Path:
    """Ten views of a board by the known camera, two of them marked test; 0.1 px of noise."""
    path = tmp_path_factory.mktemp("observations") / "front.npz"
    observations = seen_board(views=12)
    split = np.array(["train"] * 10 + ["test"] * 2)
    save_observations(path, replace(observations, split=split[: len(observations.image_names)]))
    return path


@pytest.fixture(scope="session")
def camera_file(observation_file, tmp_path_factory) -> Path:
    """The camera file that ``calibrate`` writes for those observations."""
    folder = tmp_path_factory.mktemp("calibrated")
    words = [
        "calibrate",
        str(observation_file),
        "--model",
        "ep_even",
        "--output",
        str(folder),
        "--no-report",
        "--json",
    ]
    assert main(words) == 0
    return folder / "front.yaml"


@pytest.fixture(scope="session")
def recording(tmp_path_factory) -> Path:
    """Folder with a bag of two small cameras that see one board each, the board's file beside it."""
    return write_small_recording(tmp_path_factory.mktemp("recording"))
