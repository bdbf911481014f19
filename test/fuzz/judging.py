"""Runs one input through one door in a process of its own, and says what of the promise does not hold."""

from __future__ import annotations

import os
import re
import resource
import shutil
import signal
import sys
import tempfile
import unicodedata
from dataclasses import dataclass
from pathlib import Path

SECONDS, MEGABYTES = 20.0, 1500.0
SEEDS = Path(__file__).resolve().parent / "seeds"
SHEET = SEEDS / "beside" / "sheet.png"  # of the camera's size
_BOARD = str(SEEDS / "board.yaml")
_BESIDE = {"metadata.yaml": "raw.mcap", "rig.yaml": "camera.yaml", "devices.txt": "observations.npz"}  # what they name


@dataclass(frozen=True)
class Verdict:
    """seconds: of processor time. megabytes: the most that a process had. faults: what of the promise does not hold."""

    code: int
    seconds: float
    megabytes: float
    faults: tuple[str, ...]
    said: str


def doors(name: str) -> list[list[str]]:
    """The commands that take a file of this name, which stands as INPUT."""
    suffix = Path(name).suffix
    observations, camera, images = (str(SEEDS / file) for file in ("observations.npz", "camera.yaml", "images.tar.gz"))
    reading = [["show", "INPUT", "--json"], ["evaluate", "INPUT", observations], ["compare", "INPUT", camera]]
    kalibr = ["export", "INPUT", "--to", "kalibr", "--output", "out.yaml"]
    if name == "devices.txt":
        return [["calibrate-fleet", "INPUT", "--output", "out", "--no-report", "--model", "kannala", "--jobs", "1"]]
    if name == "camera.yaml":
        rectified = ["rectify", "INPUT", str(SHEET), "--size", "64x48", "--output", "out"]
        return [*reading, ["show", "INPUT"], kalibr, rectified]
    if name.startswith("camera_in_"):
        return reading
    if name == "rig.yaml":
        return [kalibr]
    if name == "metadata.yaml":
        return [["detect", "FOLDER", "--target", _BOARD, "--output", "out", "--workers", "1"]]
    if suffix == ".yaml":
        return [["target", "INPUT"], ["target", "INPUT", "--output", "out.svg"],
                ["detect", images, "--target", "INPUT", "--output", "out", "--workers", "1"]]  # fmt: skip
    if suffix == ".npz":
        calibrate = ["calibrate", "INPUT", "--no-report", "--json", "--output", "out"]
        return [[*calibrate, "--model", "kannala"], [*calibrate, "--model", "ep_even"], ["evaluate", camera, "INPUT"]]
    if name.startswith("board_of_"):
        board = str(SEEDS / f"target_{Path(name).stem.removeprefix('board_of_')}.yaml")
        return [["detect", "INPUT", "--target", board, "--output", "out", "--workers", "1"]]
    return [["detect", "INPUT", "--target", _BOARD, "--output", "out", "--workers", "1"]]


def judged(name: str, content: bytes, door: list[str]) -> Verdict:
    """The input as a file of that name, through the door."""
    place = Path(tempfile.mkdtemp(prefix="fuzz_"))
    try:
        (place / "tmp").mkdir()
        folder = place / "in"
        folder.mkdir()
        (folder / name).write_bytes(content)
        if name in _BESIDE:
            shutil.copy(SEEDS / _BESIDE[name], folder)
        words = [str(folder / name) if word == "INPUT" else str(folder) if word == "FOLDER" else word for word in door]
        return _run(place, words)
    finally:
        shutil.rmtree(place, ignore_errors=True)


def _run(place: Path, words: list[str]) -> Verdict:
    child = os.fork()
    if child == 0:
        _become_the_command(place, words)
    _, status, usage = os.wait4(child, 0)
    code = os.waitstatus_to_exitcode(status)
    said = (place / "said").read_text("utf-8", "replace")
    seconds, megabytes = usage.ru_utime + usage.ru_stime, usage.ru_maxrss / 1e3
    faults = []
    if code not in (0, 1, 2):
        faults.append(f"exit code {code}")
    if "Traceback" in said or "out of memory" in said:
        faults.append("traceback or out of memory")
    if words[0] == "calibrate-fleet":  # which says of each device why it failed
        if re.search(r"[A-Z]\w+Error: ", said):
            faults.append("a defect")
    elif (
        code in (1, 2)
        and sum("error:" in line for line in said.splitlines()) != 1
        and not _is_a_verdict(words[0], said)
    ):
        faults.append("not one line of error")
    if any(unicodedata.category(character)[0] == "C" and character not in "\n\t\r" for character in said):
        faults.append("control characters are printed")
    if seconds > SECONDS:
        faults.append(f"{seconds:.0f} s")
    if megabytes > MEGABYTES:
        faults.append(f"{megabytes:.0f} MB")
    return Verdict(code, seconds, megabytes, tuple(faults + _left(place, code)), said)


def _is_a_verdict(command: str, said: str) -> bool:
    """Whether the camera is judged as not to be used, which ends with exit code 1 too; views may be named after it."""
    judged = any(line.endswith("do not use it here.") for line in said.splitlines())
    return command == "evaluate" and judged and "error:" not in said


def _left(place: Path, code: int) -> list[str]:
    """What lies where it should not."""
    faults = []
    if list((place / "tmp").iterdir()):
        faults.append("something is left in the temporary folder")
    if {path.name for path in place.iterdir()} - {"tmp", "in", "said", "out", "out.svg", "out.yaml"}:
        faults.append("something is written beside the output")
    out = place / "out"
    if list(out.rglob("*.unfinished")) or (code and list(out.glob("*.yaml"))):
        faults.append("half of an output")
    return faults


def _become_the_command(place: Path, words: list[str]) -> None:
    """In the forked process: never returns."""
    code = 99
    try:
        os.chdir(place)
        os.environ["TMPDIR"] = str(place / "tmp")
        tempfile.tempdir = None
        said = os.open("said", os.O_WRONLY | os.O_CREAT | os.O_TRUNC, 0o644)
        os.dup2(said, 1)
        os.dup2(said, 2)
        sys.stdout, sys.stderr = (os.fdopen(os.dup(number), "w", encoding="utf-8") for number in (1, 2))
        resource.setrlimit(resource.RLIMIT_CPU, (60, 60))
        resource.setrlimit(resource.RLIMIT_DATA, (3 << 30, 3 << 30))
        signal.signal(signal.SIGALRM, signal.SIG_DFL)
        signal.alarm(300)
        from fisheye_ep_calib.cli import main

        try:
            code = main(words)
        except SystemExit as end:
            code = end.code if isinstance(end.code, int) else 1
        except BaseException:
            import traceback

            traceback.print_exc()
            code = 1
        sys.stdout.flush()
        sys.stderr.flush()
    finally:
        os._exit(code)
