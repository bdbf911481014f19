"""Any input ends with exit 0, 1 or 2 and one line, within 20 s and 1.5 GB, and output whole or absent."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

import pytest
from judging import SEEDS, doors, judged

HERE = Path(__file__).resolve().parent


@pytest.mark.slow
@pytest.mark.parametrize("name", sorted(path.name for path in SEEDS.iterdir() if path.is_file()))
def test_sound_inputs_pass_every_door(name) -> None:
    for door in doors(name):
        verdict = judged(name, (SEEDS / name).read_bytes(), door)
        assert not verdict.faults, verdict
        assert verdict.code == 0 or name.startswith(("image.", "target_")), verdict


@pytest.mark.slow
def test_changed_inputs_for_half_a_minute() -> None:
    ended = subprocess.run([sys.executable, HERE / "run.py", "0.5", "1"], capture_output=True, text=True, timeout=280)
    assert ended.returncode == 0, ended.stdout + ended.stderr


def test_the_judge_sees_what_it_looks_for(tmp_path, monkeypatch) -> None:
    """A command that prints a traceback, leaves half an output and a temporary file is found out."""
    monkeypatch.setattr("fisheye_ep_calib.cli.main", _misbehave)
    verdict = judged("board.yaml", b"x", ["target", "INPUT"])
    for fault in (
        "exit code 7",
        "traceback",
        "control characters",
        "left in the temporary",
        "beside",
        "half of",
    ):
        assert any(fault in found for found in verdict.faults), (fault, verdict.faults)


def _misbehave(words) -> int:
    print("Traceback \x1b[31m", flush=True)
    Path("tmp/left").touch()
    Path("beside").touch()
    Path("out").mkdir()
    Path("out/camera.yaml").touch()
    return 7
