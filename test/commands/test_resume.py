"""What was found outlives interruptions and failures, and results appear whole or not at all."""

from __future__ import annotations

import json
import signal
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from dask_processes import scheduler, workers

from fisheye_ep_calib.collection import look_in_time as looking
from fisheye_ep_calib.pipeline import calibrating, writing
from fisheye_ep_calib.storage.observation_file import load_observations

TOPICS = ("--topic", "front=/left/image_raw", "--topic", "rear=/right/image_raw")
OPTIONS = ("--model", "kannala", "--workers", 1, "--passes", 1, "--no-report")


@pytest.fixture
def looked(monkeypatch) -> list:
    """Grows by one for every image that is looked at. ``looked.stop`` raises when that many have been."""

    class Looked(list):
        stop = None

    count = Looked()
    look = looking.look

    def counted(recording, detector, job, *time):
        if count.stop is not None and len(count) == count.stop:
            raise KeyboardInterrupt
        count.append(job)
        return look(recording, detector, job, *time)

    monkeypatch.setattr(looking, "look", counted)
    return count


@pytest.fixture
def words(recording):
    return ("calibrate", recording / "rig.mcap", "--target", recording / "board.yaml", *TOPICS, *OPTIONS)


def names(folder: Path) -> set[str]:
    return {str(path.relative_to(folder)) for path in folder.rglob("*") if path.is_file()}


WHOLE = {"front.yaml", "rear.yaml", "observations/front.npz", "observations/rear.npz", "calibration.json"}


def test_an_interrupted_calibration_goes_on_where_it_stopped(command, words, looked, tmp_path):
    assert command(*words, "--output", "whole").code == 0
    looked.clear()
    looked.stop = 15
    ended = command(*words, "--output", "out")
    assert ended.code == 130 and ended.out == "" and "Traceback" not in ended.err
    last = ended.err.splitlines()[-1]
    assert "what 15 images showed is kept in" in last and "--resume goes on from there" in last
    assert names(tmp_path / "out") == {".detections.jsonl"} and not list(tmp_path.glob(".*"))

    looked.clear()
    looked.stop = None
    assert command(*words, "--output", "out", "--resume").code == 0
    assert len(looked) == 24 - 15
    assert names(tmp_path / "out") == WHOLE and not list(tmp_path.glob(".*"))
    for camera in ("front", "rear"):
        one, other = (tmp_path / folder / "observations" / f"{camera}.npz" for folder in ("whole", "out"))
        assert one.read_bytes() == other.read_bytes()


def test_an_interruption_of_the_second_pass_ends_it_all(command, words, looked, tmp_path):
    twice = (*words, "--passes", 2)
    assert command(*twice, "--output", "whole").code == 0
    looked.clear()
    looked.stop = 28
    ended = command(*twice, "--output", "out")
    assert ended.code == 130 and "what 24 images showed is kept" in ended.err.splitlines()[-1]
    assert names(tmp_path / "out") <= {".detections.jsonl"}
    looked.stop = None
    assert command(*twice, "--output", "out", "--resume").code == 0
    assert names(tmp_path / "out") == WHOLE and not list(tmp_path.glob(".*"))


def test_an_interrupted_evaluation_has_no_figures(command, words, looked, observation_file, tmp_path):
    assert command("calibrate", observation_file, "--output", "out", "--no-report").code == 0
    looked.stop = 3
    topic = ("--topic", "/left/image_raw", "--workers", 1)
    command("evaluate", "out/front.yaml", *words[1:4], *topic, "--json").refused(130, "interrupted")


@pytest.mark.parametrize("option", [("--model", "auto", "--terms", 0), ("--svp-distance", -1), ("--max-views", 0)])
def test_options_that_cannot_be_met_are_refused_before_images_are_looked_at(command, words, looked, option):
    command(*words, *option).refused(2)
    assert not looked


def test_results_are_written_though_nobody_reads_the_words(observation_file, tmp_path):
    program = "import sys; from fisheye_ep_calib.cli import main; sys.exit(main(sys.argv[1:]))"
    words = [sys.executable, "-c", program, "calibrate", observation_file, "--model", "kannala", "--output", "out"]
    ended = subprocess.Popen(words, cwd=tmp_path, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True)
    ended.stdout.close()
    _, said = ended.communicate(timeout=120)
    slow = " s so far"  # what a slow machine says meanwhile
    assert ended.returncode == 0 and all(line.endswith(slow) for line in said.splitlines()), said
    assert {"front.yaml", "calibration.json", "report.html"} <= names(tmp_path / "out")


def test_an_interruption_before_anything_was_seen_leaves_nothing(command, words, looked, tmp_path):
    looked.stop = 0
    command(*words).refused(130, "interrupted")
    assert not list(tmp_path.iterdir())


def test_one_image_is_not_called_images(command, words, looked):
    looked.stop = 1
    assert "; what 1 image showed is kept in" in command(*words).err.splitlines()[-1]


def test_nothing_to_resume_is_said(command, words, looked, tmp_path):
    ended = command(*words, "--resume")
    assert ended.code == 0 and "nothing to resume" in ended.err and len(looked) == 24


def test_what_was_found_outlives_a_calibration_that_fails(command, words, looked, tmp_path):
    few = ("--every", 6)  # two views a camera
    ended = command(*words, *few, "--output", "new/folder")
    assert (
        ended.code == 1
        and "--resume" in ended.err.splitlines()[-1]
        and names(tmp_path / "new") <= {"folder/.detections.jsonl"}
    )
    looked.clear()
    assert command(*words, "--every", 1, "--output", "new/folder", "--resume").code == 0
    assert len(looked) == 20 and names(tmp_path / "new" / "folder") == WHOLE
    assert {path.name for path in tmp_path.iterdir()} == {"new"}


def test_a_camera_that_fails_beside_others_keeps_its_observations(command, words, monkeypatch, tmp_path):
    calibrate = calibrating.calibrate
    assert command(*words, "--output", "whole").code == 0
    pixels = load_observations(tmp_path / "whole" / "observations" / "rear.npz").pixels
    seen = iter([True, False])
    monkeypatch.setattr(
        calibrating,
        "calibrate",
        lambda observations, *given, **options: calibrate(
            observations if next(seen) else observations.select_images([0, 1]), *given, **options
        ),
    )
    ended = command(*words, "--output", "out", "--json")
    assert ended.code == 1 and ended.json["cameras"].keys() == {"front"}
    assert "rear: error: 2 views have" in ended.err and "what was found is in out/observations/rear.npz" in ended.err
    np.testing.assert_array_equal(load_observations(tmp_path / "out" / "observations" / "rear.npz").pixels, pixels)
    assert names(tmp_path / "out") == WHOLE - {"rear.yaml"} and not list(tmp_path.glob(".*"))


@pytest.mark.parametrize("name", ["front.yaml", "calibration.json", "observations/front.npz"])
def test_a_folder_that_is_taken_is_refused_before_images_are_looked_at(command, words, looked, tmp_path, name):
    (tmp_path / "out" / "observations").mkdir(parents=True)
    (tmp_path / "out" / name).write_text("mine")
    command(*words, "--output", "out").refused(2, f"out/{name} is there already", "--overwrite")
    assert not looked and names(tmp_path) == {f"out/{name}"} and (tmp_path / "out" / name).read_text() == "mine"


@pytest.mark.parametrize("folder_there", [False, True])
def test_a_crash_leaves_no_half_written_folder(command, words, looked, monkeypatch, tmp_path, folder_there):
    if folder_there:
        (tmp_path / "out").mkdir()
        (tmp_path / "out" / "notes.txt").write_text("mine")
    save_camera = writing.save_camera

    def crash(path, *given):
        if path.name == "rear.yaml":
            raise RuntimeError("a defect")
        save_camera(path, *given)

    monkeypatch.setattr(writing, "save_camera", crash)
    with pytest.raises(RuntimeError):
        command(*words, "--output", "out")
    assert names(tmp_path) == {"out/.detections.jsonl"} | ({"out/notes.txt"} if folder_there else set())
    monkeypatch.setattr(writing, "save_camera", save_camera)
    looked.clear()
    assert command(*words, "--output", "out", "--resume").code == 0
    assert not looked and names(tmp_path / "out") >= WHOLE


def test_detect_resumes_too(command, recording, looked, tmp_path):
    words = ("detect", recording / "rig.mcap", "--target", recording / "board.yaml", *TOPICS, "--workers", 1)
    assert command(*words, "--output", "whole").code == 0
    looked.clear()
    looked.stop = 15
    ended = command(*words, "--output", "out")
    assert ended.code == 130 and "--resume" in ended.err and names(tmp_path / "out") == {".detections.jsonl"}
    looked.clear()
    looked.stop = None
    assert command(*words, "--output", "out", "--resume", "--overlay").code == 0 and len(looked) == 9
    assert (tmp_path / "whole" / "front.npz").read_bytes() == (tmp_path / "out" / "front.npz").read_bytes()
    assert len(list((tmp_path / "out" / "rear_overlay").glob("*.png"))) == 12
    command(*words, "--output", "out").refused(2, "front.npz is there already")


def test_a_cluster_gives_the_same_files(command, words, tmp_path):
    pytest.importorskip("distributed")
    both = (*words, "--passes", 2, "--output")
    assert command(*both, "here").code == 0
    with scheduler(tmp_path) as address, workers(address, 2):
        ended = command(*both, "there", "--scheduler", address)
    assert ended.code == 0, ended.err
    for name in ("front", "rear"):
        one, other = (tmp_path / folder / "observations" / f"{name}.npz" for folder in ("here", "there"))
        assert one.read_bytes() == other.read_bytes()
    options = json.loads((tmp_path / "there" / "calibration.json").read_text())["options"]
    assert options["scheduler"] == address
    command(*words, "--scheduler", "nonsense").refused(
        2, "--scheduler 'nonsense' is no address such as tcp://HOST:PORT"
    )


def test_a_termination_ends_like_an_interruption():
    program = (
        "import time; from fisheye_ep_calib import cli; from fisheye_ep_calib.commands import show\n"
        "show.run = lambda _: (print('ready', flush=True), time.sleep(60))\n"
        "raise SystemExit(cli.main(['show', 'any.yaml']))"
    )
    process = subprocess.Popen(
        [sys.executable, "-c", program], stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True
    )
    assert process.stdout.readline() == "ready\n"
    process.terminate()
    _, said = process.communicate(timeout=20)
    assert process.returncode == 130
    assert "interrupted" in said and "Traceback" not in said


def interrupted_at(module: str, number: int, *words: object) -> tuple[int, str]:
    """Exit code and stderr of a command line that gets a signal as it begins to import a module."""
    program = (
        "import os, sys\n"
        "class Interrupting:\n"
        "    def find_spec(name, path, target=None):\n"
        f"        if name == {module!r}: os.kill(os.getpid(), {int(number)})\n"
        "sys.meta_path.insert(0, Interrupting)\n"
        "from fisheye_ep_calib.cli import main\n"
        "sys.exit(main(sys.argv[1:]))"
    )
    command_line = [sys.executable, "-c", program, *map(str, words)]
    ended = subprocess.run(command_line, capture_output=True, text=True, timeout=60)
    return ended.returncode, ended.stderr


@pytest.mark.parametrize("module", ["fisheye_ep_calib.commands.parser", "numpy", "cv2"])
@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
def test_an_interruption_while_modules_are_imported_is_one_line(module, number):
    said = interrupted_at(module, number, "detect", "any.mcap")
    assert said == (130, "fisheye_ep_calib: error: interrupted\n")


@pytest.mark.parametrize("module", ["scipy", "scipy.linalg", "scipy.linalg._decomp", "scipy.special"])
@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
def test_an_interruption_while_the_work_imports_what_it_needs_is_one_line(module, number, observation_file, tmp_path):
    words = ("calibrate", observation_file, "--model", "kannala", "--no-report", "--output", tmp_path / "out")
    assert interrupted_at(module, number, *words) == (130, "fisheye_ep_calib: error: interrupted\n")


def test_part_of_an_observation_file_does_not_replace_it(command, observation_file, tmp_path):
    (tmp_path / "observations").mkdir()
    own = tmp_path / "observations" / "front.npz"
    own.write_bytes(observation_file.read_bytes())
    words = ("calibrate", "observations/front.npz", "--split", "train", "--no-report", "--output", ".")
    command(*words).refused(2, "observations/front.npz is there already")
    command(*words, "--overwrite").refused(2, "--split train would lose its source's other images")
    assert own.read_bytes() == observation_file.read_bytes()


def test_what_an_earlier_calibration_left_is_named(command, words, tmp_path):
    assert command(*words, "--output", "out").code == 0
    again = command(*words[:4], "--topic", "front=/left/image_raw", *OPTIONS, "--output", "out", "--overwrite")
    assert again.code == 0 and "note: out/rear.yaml is of an earlier calibration" in again.err
    assert "front.yaml is of" not in again.err
