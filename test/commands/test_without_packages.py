"""What the command does without packages that only bags need."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

import pytest

import fisheye_ep_calib

# tqdm and distributed are never needed; without mcap and rosbags there are no bags.
PROGRAM = """
import sys
for name in ("mcap", "rosbags", "tqdm", "distributed", "zstandard", "lz4", "calib_targets"):
    sys.modules[name] = None
from fisheye_ep_calib.cli import main
sys.exit(main(sys.argv[1:]))
"""


def without(tmp_path, *words):
    root = str(Path(fisheye_ep_calib.__file__).parents[1])
    return subprocess.run(
        [sys.executable, "-c", PROGRAM, *map(str, words)],
        cwd=tmp_path, capture_output=True, text=True, timeout=120, env={**os.environ, "PYTHONPATH": root},
    )  # fmt: skip


def test_help_and_observation_files_work(observation_file, tmp_path):
    shown = without(tmp_path, "--help")
    assert shown.returncode == 0 and "calibrate-fleet" in shown.stdout and not shown.stderr
    made = without(tmp_path, "calibrate", observation_file, "--model", "kannala", "--no-report")
    assert made.returncode == 0, made.stderr
    assert (tmp_path / "calibration" / "front.yaml").exists()


@pytest.mark.parametrize(
    ("words", "package"),
    [
        (["calibrate", "rig.mcap", "--target", "board.yaml", "--topic", "/left/image_raw"], "mcap"),
        (["simulate", "--output", "out.mcap"], "mcap"),
        (["calibrate", "a.npz", "--scheduler", "tcp://127.0.0.1:1"], ""),
    ],
)
def test_what_is_missing_is_named(recording, observation_file, tmp_path, words, package):
    for name in ("rig.mcap", "board.yaml"):
        (tmp_path / name).symlink_to(recording / name)
    (tmp_path / "a.npz").symlink_to(observation_file)
    ended = without(tmp_path, *words, *(["--model", "kannala", "--no-report"] if not package else []))
    if not package:
        assert ended.returncode == 0, ended.stderr  # nothing to look at: the scheduler is not asked
        return
    assert ended.returncode == 2 and ended.stderr.count("\n") == 1, ended.stderr
    assert f"pip install {package}" in ended.stderr
