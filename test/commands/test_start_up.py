"""What the command line imports before it answers, and what a shell can complete. benchmarks/start_up.py has times."""

from __future__ import annotations

import os
import subprocess
import sys

import pytest

NOT_FOR_WORDS = {"numpy", "yaml", "scipy", "cv2", "matplotlib", "jinja2", "mcap", "rosbags", "tqdm", "multiprocessing"}
NOT_FOR_SHOW = NOT_FOR_WORDS - {"numpy", "yaml"}
NOT_FOR_ARGUMENTS = {"scipy", "matplotlib", "jinja2", "mcap", "rosbags"}
LOADED = """
import sys
from fisheye_ep_calib.cli import main
try:
    code = main(sys.argv[1:])
except SystemExit as end:
    code = end.code
print(*sorted({name.partition(".")[0] for name in sys.modules}), file=sys.stderr)
sys.exit(code)
"""


def loaded(*words: object) -> tuple[int, set[str]]:
    """Exit code of a command line, and the packages that its process had loaded when it ended."""
    ended = subprocess.run([sys.executable, "-c", LOADED, *map(str, words)], capture_output=True, text=True, timeout=60)
    return ended.returncode, set(ended.stderr.splitlines()[-1].split())


@pytest.mark.parametrize(("words", "code"), [(["--help"], 0), (["--version"], 0), (["calibrte"], 2), ([], 2)])
def test_a_word_is_answered_without_any_library(words, code):
    ended, packages = loaded(*words)
    assert ended == code
    assert "argparse" in packages and packages & NOT_FOR_WORDS == set()


@pytest.mark.parametrize("form", [[], ["--json"]])
def test_a_camera_is_shown_without_what_calibrates(camera_file, form):
    ended, packages = loaded("show", camera_file, *form)
    assert ended == 0
    assert "numpy" in packages and packages & NOT_FOR_SHOW == set()


@pytest.mark.parametrize("command", ["calibrate", "calibrate-fleet", "evaluate", "detect", "compare", "rectify"])
def test_arguments_are_known_without_what_the_work_takes(command):
    ended, packages = loaded(command, "--help")
    assert ended == 0 and packages & NOT_FOR_ARGUMENTS == set()


@pytest.mark.parametrize(("given", "expected"), [({}, "1"), ({"OMP_NUM_THREADS": "3"}, None)])
def test_a_command_calculates_in_one_thread_unless_told_otherwise(given, expected):
    script = (
        "import os, sys; from fisheye_ep_calib.cli import main; name = sys.argv.pop();"
        "sys.argv[1:] = ['show', '-']; main(); print(os.environ.get(name))"
    )
    clean = {name: value for name, value in os.environ.items() if not name.endswith("_NUM_THREADS")}
    ended = subprocess.run(
        [sys.executable, "-c", script, "OPENBLAS_NUM_THREADS"], env=clean | given, capture_output=True, text=True
    )
    assert ended.stdout.split()[-1] == str(expected)


def completed(line: str, tmp_path) -> set[str]:
    """What argcomplete's protocol answers to Tab at the end of the line; nothing may be printed beside it."""
    answer = tmp_path / "answer"
    asked = {
        "_ARGCOMPLETE": "1",
        "_ARGCOMPLETE_SHELL": "bash",
        "_ARGCOMPLETE_IFS": "\n",
        "_ARGCOMPLETE_SUPPRESS_SPACE": "1",
        "_ARGCOMPLETE_STDOUT_FILENAME": str(answer),
        "COMP_LINE": line,
        "COMP_POINT": str(len(line)),
        "COMP_TYPE": "9",
    }
    ended = subprocess.run(
        [sys.executable, "-m", "fisheye_ep_calib"],
        env={**os.environ, **asked}, capture_output=True, text=True, timeout=60, cwd=tmp_path,
    )  # fmt: skip
    assert (ended.returncode, ended.stdout) == (0, ""), ended.stderr
    return set(answer.read_text("utf-8").split())


def test_a_shell_completes_commands_options_and_choices(tmp_path):
    pytest.importorskip("argcomplete")
    assert completed("fisheye_ep_calib calib", tmp_path) == {"calibrate", "calibrate-fleet"}
    assert completed("fisheye_ep_calib calibrate --mod", tmp_path) == {"--model"}
    assert {"ep_odd", "ep_even"} <= completed("fisheye_ep_calib calibrate --model ep_", tmp_path)
    assert completed("fisheye_ep_calib show --j", tmp_path) == {"--json"}
    (tmp_path / "front.yaml").touch()
    assert completed("fisheye_ep_calib show fr", tmp_path) == {"front.yaml"}


def test_without_argcomplete_nothing_is_completed_and_nothing_printed(tmp_path):
    program = f"import sys\nsys.modules['argcomplete'] = None\n{LOADED}"
    ended = subprocess.run(
        [sys.executable, "-c", program],
        env={**os.environ, "_ARGCOMPLETE": "1", "COMP_LINE": "fisheye_ep_calib ", "COMP_POINT": "17"},
        capture_output=True, text=True, timeout=60, cwd=tmp_path,
    )  # fmt: skip
    assert (ended.returncode, ended.stdout) == (1, "") and "Traceback" not in ended.stderr
