"""Processor time until the command line answers, as multiples of ``python -c 'import numpy'``.

    python benchmarks/start_up.py [--runs 15]

User and system time of whole processes, in turn, so that a busy machine slows all of them alike; medians.
"""

from __future__ import annotations

import argparse
import os
import statistics
import subprocess
import sys
import tempfile
from dataclasses import replace
from pathlib import Path

import numpy as np

from fisheye_ep_calib.calibration import calibrate
from fisheye_ep_calib.simulation import observe, paper_camera, paper_poses, paper_target
from fisheye_ep_calib.storage.camera_file import save_camera

YARDSTICK = "import numpy"


def processor_seconds(command: list[str]) -> float:
    """User plus system time of one process."""
    process = subprocess.Popen(command, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
    _, status, usage = os.wait4(process.pid, 0)
    process.returncode = os.waitstatus_to_exitcode(status)
    return usage.ru_utime + usage.ru_stime


def write_camera(path: Path) -> None:
    camera, target = paper_camera(), paper_target()
    seen = observe(camera, target, paper_poses(target, 0))
    noise = np.random.default_rng(0).normal(scale=0.05, size=seen.pixels.shape)
    result = calibrate(replace(seen, pixels=seen.pixels + noise), "ep_odd")
    save_camera(path, result, "front", "benchmarks/start_up.py")


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--runs", type=int, default=15)
    runs = parser.parse_args().runs
    with tempfile.TemporaryDirectory() as folder:
        camera = Path(folder) / "front.yaml"
        write_camera(camera)
        program = [sys.executable, "-m", "fisheye_ep_calib"]
        commands = {
            YARDSTICK: [sys.executable, "-c", YARDSTICK],
            "--help": [*program, "--help"],
            "--version": [*program, "--version"],
            "a mistyped word": [*program, "calibrte"],
            "show CAMERA": [*program, "show", str(camera)],
            "show CAMERA --json": [*program, "show", str(camera), "--json"],
            "calibrate --help": [*program, "calibrate", "--help"],
        }
        seconds: dict[str, list[float]] = {name: [] for name in commands}
        for _ in range(runs):
            for name, command in commands.items():
                seconds[name].append(processor_seconds(command))
    median = {name: statistics.median(values) for name, values in seconds.items()}
    print(f"{'':<20}{'seconds':>9}{'ratio':>8}")
    for name, value in median.items():
        print(f"{name:<20}{value:>9.3f}{value / median[YARDSTICK]:>8.2f}")


if __name__ == "__main__":
    main()
