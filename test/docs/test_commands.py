"""Every command that README and docs show is one that works: parsed here, run in full by the slow tests."""

from __future__ import annotations

import os
import re
import shlex
import shutil
import subprocess
import sys
from pathlib import Path

import cv2
import numpy as np
import pytest

from fisheye_ep_calib import open_recording
from fisheye_ep_calib.commands.parser import build_parser
from fisheye_ep_calib.storage.rig_file import places_yaml

REPOSITORY = Path(__file__).resolve().parents[2]
PAGES = sorted([REPOSITORY / "README.md", REPOSITORY / "CONTRIBUTING.md", *(REPOSITORY / "docs").glob("*.md")])
SHELL_BLOCK = re.compile(r"^```(?:sh|bash)\n(.*?)^```", re.MULTILINE | re.DOTALL)
COMMAND = "fisheye_ep_calib"

NOT_RUN = {  # how a line begins, and why no test here runs it
    "make ": "continuous integration runs them",
    ".venv/bin/pytest": "these tests themselves",
    "pip install": "changes the machine",
    "rosdep ": "needs a ROS machine",
    "colcon ": "needs a ROS machine; test/packaging builds with colcon",
    ". install/setup.bash": "needs a ROS machine",
    "ros2 ": "needs the ros2 tools; test/ros starts the same nodes with the same parameters",
    'eval "$(register-python-argcomplete': "a shell's own; test/commands completes through argcomplete",
    "g++ ": "test_examples compiles and runs it",
    'echo "0.05 0.02 0.08"': "test_examples compiles and runs it",
    "dask ": "test/collection starts a scheduler and workers",
    "export DASK_": "wants certificates of your own",
}
OWN_NOT_RUN = {  # what an own line has in it, and why it is understood but not run
    "--scheduler ": "test/collection looks on a cluster",
    " SOURCE ": "stands for any source",
}
INDENTED = re.compile(rf"^    (?:{COMMAND}|pip|ros2|dask) ", re.MULTILINE)
RECORD = "simulate --poses random --views 12 --target board.yaml --output {} --seed {} --camera {}"
CALIBRATE = "calibrate {} --target board.yaml --topic {} --model ep_odd --no-report --output {}"
FRONT = "front=/front/image_raw"
ONE_CAMERA = (
    "target --new circle_grid_11x7_holed > board.yaml",
    RECORD.format("recording.mcap", 0, "front=paper"),
    RECORD.format("other.mcap", 1, "front=paper"),
    CALIBRATE.format("recording.mcap", FRONT, "monday"),
    CALIBRATE.format("other.mcap", FRONT, "tuesday"),
    CALIBRATE.format("recording.mcap", FRONT, "calibration"),
)
TWO_CAMERAS = (
    "target --new circle_grid_11x7_holed > board.yaml",
    RECORD.format("recording.mcap", 0, "left=laikin --camera right=laikin"),
    CALIBRATE.format("recording.mcap", "left=/left/image_raw --topic right=/right/image_raw", "calibration"),
)


def shell_lines(page: Path) -> list[str]:
    """The commands of a page's shell blocks, without comments, continued lines joined."""
    blocks = SHELL_BLOCK.findall(page.read_text(encoding="utf-8"))
    lines = "\n".join(blocks).replace("\\\n", " ").splitlines()
    return [line.strip() for line in lines if line.strip() and not line.lstrip().startswith("#")]


def own_lines(page: Path) -> list[str]:
    return [line for line in shell_lines(page) if line.split()[0] == COMMAND]


def arguments_of(line: str) -> list[str]:
    words = shlex.split(line, comments=True)
    return words[1 : words.index(">")] if ">" in words else words[1:]


@pytest.mark.parametrize("page", PAGES, ids=lambda page: page.stem)
def test_commands_stand_in_shell_blocks(page):
    """Where these tests find them."""
    assert not INDENTED.findall(re.sub(r"^```.*?^```", "", page.read_text("utf-8"), flags=re.MULTILINE | re.DOTALL))


@pytest.mark.parametrize("page", PAGES, ids=lambda page: page.stem)
def test_benchmarks_that_are_named_are_there(page):
    named = set(re.findall(r"\bbenchmarks/[\w/]+\.py", page.read_text("utf-8")))
    assert not [name for name in named if not (REPOSITORY / name).exists()]


@pytest.mark.parametrize("page", PAGES, ids=lambda page: page.stem)
def test_each_command_is_run_or_said_why_not(page):
    others = [line for line in shell_lines(page) if line.split()[0] != COMMAND]
    assert not [line for line in others if not line.startswith(tuple(NOT_RUN))]


@pytest.mark.parametrize(
    "line", sorted({line for page in PAGES for line in own_lines(page)}), ids=lambda line: line[len(COMMAND) + 1 :][:60]
)
def test_each_command_is_understood(line):
    words = arguments_of(line)
    arguments = build_parser(COMMAND, words).parse_args(words)  # ends the test where an option is unknown
    assert arguments.run


def run(line: str, folder: Path) -> None:
    path = os.pathsep.join([str(Path(sys.executable).parent), os.environ["PATH"]])
    done = subprocess.run(
        line, shell=True, cwd=folder, env={**os.environ, "PATH": path}, capture_output=True, text=True, timeout=280
    )
    assert done.returncode == 0, f"{line}\n{done.stderr}"


def one_camera(folder: Path) -> None:
    """A recording of one camera, another, its images, and its calibration."""
    for command in ONE_CAMERA:
        run(f"{COMMAND} {command}", folder)
    shutil.copy(folder / "calibration" / "front.yaml", folder)
    images = folder / "images"
    images.mkdir()
    with open_recording(folder / "recording.mcap") as recording:
        for number, frame in enumerate(recording.frames()):
            assert cv2.imwrite(str(images / f"{number:02}.png"), frame.image())


def two_cameras(folder: Path) -> None:
    """A recording of two cameras, and their calibrations."""
    for command in TWO_CAMERAS:
        run(f"{COMMAND} {command}", folder)
    for name in ("left", "right"):
        shutil.copy(folder / "calibration" / f"{name}.yaml", folder)
    shutil.copytree(folder / "calibration" / "observations", folder / "observations")


def other_programs(folder: Path) -> None:
    """A camera, the same in another program's format, and a rig of two of it."""
    one_camera(folder)
    run(f"{COMMAND} export front.yaml --to opencv --output theirs.yaml", folder)
    rig_of_two(folder, "front.yaml", "front.yaml")


def rig_of_two(folder: Path, *files: str) -> None:
    """The file of a rig of two cameras side by side, of no calibration."""
    places = {"left": np.eye(4), "right": np.eye(4)}
    places["right"][0, 3] = 0.08
    text = places_yaml(places)
    for name, file in zip(places, files, strict=True):
        text = text.replace(f"  {name}:\n", f"  {name}:\n    camera_file: {file}\n")
    (folder / "rig.yaml").write_text(text)


def chessboard_seen(folder: Path) -> None:
    """A recording of the board that the page begins a file for."""
    run(f"{COMMAND} target --new chessboard > board.yaml", folder)
    run(f"{COMMAND} {RECORD.format('recording.mcap', 0, 'front=paper')}", folder)


def fleet(folder: Path) -> None:
    """Recordings of two devices, and a list of them."""
    for command in ONE_CAMERA[:3]:
        run(f"{COMMAND} {command}", folder)
    (folder / "recordings").mkdir()
    for name in ("recording", "other"):
        (folder / f"{name}.mcap").rename(folder / "recordings" / f"{name}.mcap")
    (folder / "monday.txt").write_text("recordings/recording.mcap\nrecordings/other.mcap\n")


PREPARE = {"rig": two_cameras, "formats": other_programs, "targets": chessboard_seen, "fleet": fleet}


@pytest.mark.slow
@pytest.mark.parametrize("page", [page for page in PAGES if own_lines(page)], ids=lambda page: page.stem)
def test_commands_of_a_page_work_one_after_the_other(page, tmp_path):
    PREPARE.get(page.stem, one_camera)(tmp_path)
    for line in own_lines(page):
        if not any(part in line for part in OWN_NOT_RUN):
            run(line, tmp_path)
