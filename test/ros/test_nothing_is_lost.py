"""A node that is killed at any moment has lost no view that it reported, and goes on where it was."""

from __future__ import annotations

import random
import re
import signal
import time
from pathlib import Path

import numpy as np
import pytest
from live_processes import Program, wait_for
from std_srvs.srv import Trigger

from fisheye_ep_calib.calibration import Observations, calibrate
from fisheye_ep_calib.storage.camera_file import load_camera

pytestmark = pytest.mark.live

REPOSITORY = Path(__file__).resolve().parents[2]
TARGET = REPOSITORY / "config" / "targets" / "circle_grid_11x7.yaml"
EVERY_VIEW = {"novelty__position": 0.0, "novelty__size": 0.0, "novelty__tilt": 0.0}


def kept(output: str) -> int:
    """The number of the last view that was reported as kept, or taken up."""
    numbers = re.findall(r"view (\d+) kept|going on with (\d+) views", output)
    return max((int(one or other) for one, other in numbers), default=0)


def wait_until_quiet(program: Program, seconds: float = 3.0) -> None:
    """Until it has said nothing for a while: frames under way have been looked at."""
    lines, since = -1, time.monotonic()
    while time.monotonic() - since < seconds:
        if len(program.lines) != lines:
            lines, since = len(program.lines), time.monotonic()
        time.sleep(0.1)


def kill_and_resume(times: int, start_calibrator, start_publisher, probe, rendered, folder: Path) -> None:
    rng = random.Random(times)
    parameters = {
        "cameras": "[front]",
        "target": TARGET,
        "output_directory": folder,
        "model": "ep_odd",
        "minimum_views": 5,
        "maximum_views": 40,
        **EVERY_VIEW,
    }
    publisher = start_publisher(rendered, 10, "/front/image_raw")
    reported = 0
    for _ in range(times):
        calibrator = start_calibrator(**parameters)
        calibrator.wait_to_say("receiving")
        time.sleep(rng.uniform(0.2, 1.5))
        calibrator.interrupt(signal.SIGKILL)
        assert kept(calibrator.output) >= reported, calibrator.output
        reported = kept(calibrator.output)
        if reported:
            observations = Observations.load(folder / "front.npz")
            assert reported <= observations.view_count <= reported + 1
        if (folder / "front.yaml").exists():
            load_camera(folder / "front.yaml")
    calibrator = start_calibrator(**parameters)
    wait_for(lambda: kept(calibrator.output) >= 10, "ten views")
    publisher.end()
    wait_until_quiet(calibrator)
    answer = probe.call(Trigger, "/calibrator/calibrate")
    assert answer.success, answer.message
    assert calibrator.interrupt()[0] == 0
    undisturbed = calibrate(Observations.load(folder / "front.npz"), model="ep_odd")
    assert f"{undisturbed.views} views" in answer.message
    camera = load_camera(folder / "front.yaml")
    print(f"killed {times} times: {reported} views reported till then, all there; {answer.message}")
    np.testing.assert_allclose(camera.parameters, undisturbed.camera.parameters, rtol=1e-9)


def test_killed_three_times(start_calibrator, start_publisher, probe, rendered, tmp_path) -> None:
    kill_and_resume(3, start_calibrator, start_publisher, probe, rendered, tmp_path)


@pytest.mark.slow
def test_killed_twenty_times(start_calibrator, start_publisher, probe, rendered, tmp_path) -> None:
    kill_and_resume(20, start_calibrator, start_publisher, probe, rendered, tmp_path)
