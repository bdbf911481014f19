"""A bag of two small cameras, rendered in seconds."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import yaml
from known_scenes import CAMERA

from fisheye_ep_calib.simulation import Imaging, SimulatedCamera, random_poses, simulate_rig, views_at, write_bag
from fisheye_ep_calib.target.boards.chessboard import Chessboard

TARGET = {"type": "chessboard", "name": "board", "columns": 8, "rows": 6, "spacing": 0.025}
BOARD = Chessboard.create("board", 8, 6, 0.025)
SMALL = replace(
    CAMERA, image_size=(640, 480), fx=190.0, fy=191.0, cx=322.0, cy=237.0, skew=0.1, theta_max=np.radians(97)
)
CAMERAS = {"left": SMALL, "right": replace(SMALL, fx=205.0, fy=204.0, cx=310.0)}
VIEWS = 12


def write_small_recording(folder: Path) -> Path:
    """rig.mcap with the topics /left/image_raw and /right/image_raw, and board.yaml beside it."""
    (folder / "board.yaml").write_text(yaml.safe_dump(TARGET))
    imaging = Imaging(blur=0.7, noise=1.0)
    rig = [
        SimulatedCamera(
            name, views_at(camera, BOARD, random_poses(BOARD, VIEWS, 5 + i, (0.14, 0.3), (0, 60), (5, 45)), imaging)
        )
        for i, (name, camera) in enumerate(CAMERAS.items())
    ]
    write_bag(folder / "rig.mcap", simulate_rig(rig, rate=2.0, start_ns=10**18, processes=1))
    return folder
