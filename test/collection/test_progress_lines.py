"""Where stderr is a file, a long run says how far it is."""

from __future__ import annotations

import re
import time
from collections.abc import Callable

from fisheye_ep_calib.collection import progress
from fisheye_ep_calib.collection.progress import Progress, ProgressBars


def told_until(enough: Callable[[str], object], capsys) -> str:
    """What stderr has got once it is enough."""
    told, give_up = "", time.monotonic() + 20
    while not enough(told) and time.monotonic() < give_up:
        time.sleep(0.02)
        told += capsys.readouterr().err
    assert enough(told), told
    return told


def test_a_piped_run_prints_a_line_now_and_then(monkeypatch, capsys) -> None:
    monkeypatch.setattr(progress, "_LINE_EACH", 0.05)
    with ProgressBars() as bars:
        bars(Progress("looking", 3, 10, 2))
        line = r"looking: 3 of 10 images, the target in 2; \d s so far"
        told_until(lambda told: len(re.findall(line, told)) >= 2, capsys)
    capsys.readouterr()
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
        told_until(lambda told: re.search(r"front: calibrating; \d s so far", told), capsys)
