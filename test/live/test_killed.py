"""A live calibrator that is killed at any moment has lost no view that it reported, and goes on where it was."""

from __future__ import annotations

import random
import signal
import sys
import time
from pathlib import Path

import numpy as np
import pytest
from known_scenes import half_size

from fisheye_ep_calib.calibration import Observations
from fisheye_ep_calib.simulation import paper_camera, paper_poses, paper_target
from fisheye_ep_calib.simulation.rendering import render
from fisheye_ep_calib.storage.camera_file import load_camera

pytest.importorskip("rclpy", reason="ROS 2 is not installed: pip install '.[ros]'")
from live_processes import Program, kept, wait_for  # noqa: E402

CAMERA = Path(__file__).with_name("endless_camera.py")
TIMES = 8


def test_killed_at_any_moment(tmp_path: Path) -> None:
    camera, target = half_size(paper_camera()), paper_target()
    images = tmp_path / "images.npz"
    np.savez(images, images=np.stack([render(camera, target, pose) for pose in paper_poses(target)[:12:2]]))
    folder, rng, reported = tmp_path / "results", random.Random(1), 0
    for turn in range(TIMES):
        program = Program([sys.executable, str(CAMERA), str(images), str(folder)])
        if turn % 4 < 3:  # the others end while they start
            wait_for(lambda program=program: " kept" in program.output or program.process.poll() is not None, "a view")
        time.sleep(rng.uniform(0.0, 1.0))
        assert program.process.poll() is None, program.output
        program.interrupt(signal.SIGKILL)
        assert kept(program.output) >= reported or "views" not in program.output, program.output
        reported = max(reported, kept(program.output))
        if reported:
            there = Observations.load(folder / "front.npz").view_count
            assert reported <= there <= reported + 2  # two workers may be about to report
        if (folder / "front.yaml").exists():
            load_camera(folder / "front.yaml")
    assert reported >= TIMES / 2
