"""Where stderr is a file, a long run says how far it is."""

from __future__ import annotations

import time

from fisheye_ep_calib.collection import progress
from fisheye_ep_calib.collection.progress import Progress, ProgressBars


def test_a_piped_run_prints_a_line_now_and_then(monkeypatch, capsys) -> None:
    monkeypatch.setattr(progress, "_LINE_EACH", 0.05)
    with ProgressBars() as bars:
        bars(Progress("looking", 3, 10, 2))
        time.sleep(0.3)
    told = capsys.readouterr().err
    assert told.count("looking: 3 of 10 images, the target in 2; 0 s so far") >= 2
    time.sleep(0.15)
    assert capsys.readouterr().err == ""


def test_a_short_run_prints_nothing(capsys) -> None:
    with ProgressBars() as bars:
        bars(Progress("looking", 10, 10, 2))
    assert "so far" not in capsys.readouterr().err


def test_a_step_without_parts_ends_the_bar_and_is_told(monkeypatch, capsys) -> None:
    monkeypatch.setattr(progress, "_LINE_EACH", 0.05)
    with ProgressBars() as bars:
        bars(Progress("looking again", 10, 10, 2))
        bars(Progress("front: calibrating"))
        time.sleep(0.2)
    assert "front: calibrating; 0 s so far" in capsys.readouterr().err
