"""A folder of results appears whole or not at all."""

import os
import stat
import subprocess
import sys

import pytest

from fisheye_ep_calib.errors import CalibrationError
from fisheye_ep_calib.storage.atomic import open_own
from fisheye_ep_calib.storage.results_folder import beside, results_folder
from fisheye_ep_calib.storage.scratch import Scratch


def everything(folder):
    return sorted(str(path.relative_to(folder)) for path in folder.rglob("*"))


def test_a_new_folder_appears_with_all_its_files(tmp_path):
    output = tmp_path / "a" / "b"
    with results_folder(output) as folder:
        (folder / "observations").mkdir()
        (folder / "observations" / "front.npz").write_text("1")
        assert folder.parent == output and folder.name.startswith(".")
        assert everything(folder) == ["observations", "observations/front.npz"]
    assert everything(tmp_path) == ["a", "a/b", "a/b/observations", "a/b/observations/front.npz"]
    mask = os.umask(0)
    os.umask(mask)
    assert stat.S_IMODE(output.stat().st_mode) == 0o777 & ~mask


def test_files_join_a_folder_that_is_there(tmp_path):
    (tmp_path / "front.yaml").write_text("old")
    (tmp_path / "notes.txt").write_text("mine")
    with results_folder(tmp_path) as folder:
        (folder / "front.yaml").write_text("new")
        (folder / "rear.yaml").write_text("new")
        assert (tmp_path / "front.yaml").read_text() == "old"
    assert everything(tmp_path) == ["front.yaml", "notes.txt", "rear.yaml"]
    assert (tmp_path / "front.yaml").read_text() == "new"


@pytest.mark.parametrize("error", [RuntimeError, KeyboardInterrupt, CalibrationError])
def test_an_exception_leaves_nothing(tmp_path, error):
    with pytest.raises(error), results_folder(tmp_path / "out") as folder:
        (folder / "front.yaml").write_text("half")
        raise error
    assert everything(tmp_path) == []


def test_nothing_written_is_nothing_made(tmp_path):
    with results_folder(tmp_path / "out"):
        pass
    assert everything(tmp_path) == []


def test_a_folder_that_another_program_makes_meanwhile_is_left_alone(tmp_path):
    with pytest.raises(CalibrationError, match="out has been made by another program; the results are in .*/out_2"):
        with results_folder(tmp_path / "out") as folder:
            (folder / "front.yaml").write_text("mine")
            (tmp_path / "out" / "front.yaml").write_text("theirs")
    assert (tmp_path / "out" / "front.yaml").read_text() == "theirs"
    assert (tmp_path / "out_2" / "front.yaml").read_text() == "mine"


@pytest.mark.skipif(os.name != "posix", reason="asks for processes")
def test_what_killed_processes_left_of_the_folder_is_removed(tmp_path):
    place = output = tmp_path / "out"
    head = "."
    place.mkdir()
    dead = subprocess.Popen([sys.executable, "-c", ""])
    dead.wait()
    gone, kept = [f"{head}{dead.pid}", f"{head}{os.getpid()}"], [f"{head}{os.getppid()}", f".a.{dead.pid}", f"{head}x"]
    young = f"{head}{dead.pid}00"  # of a process on another machine, perhaps
    for name in [*gone, *kept, young]:
        (place / f"{name}.unfinished").mkdir()
        (place / f"{name}.unfinished" / "front.yaml").touch()
        if name != young:
            os.utime(place / f"{name}.unfinished", (0, 0))
    (place / f"{head}{dead.pid}0.unfinished").touch()  # no folder
    with results_folder(output) as folder:
        (folder / "rear.yaml").touch()
    left = {path.name for path in place.iterdir() if path.name.startswith(".")}
    assert left == {f"{name}.unfinished" for name in [*kept, young, f"{head}{dead.pid}0"]}
    assert [path.name for path in output.glob("[!.]*")] == ["rear.yaml"]


def test_nothing_is_written_above_the_folder(tmp_path):
    assert beside(tmp_path / "a" / "b", "log") == tmp_path / "a" / "b" / ".log"
    with results_folder(tmp_path / "a" / "b") as folder:
        assert everything(tmp_path) == ["a", "a/b", f"a/b/{folder.name}"]
        (folder / "x").touch()
    with pytest.raises(ValueError), results_folder(tmp_path / "c" / "d"):
        raise ValueError
    assert everything(tmp_path) == ["a", "a/b", "a/b/x"]


def test_results_are_not_written_through_links(tmp_path):
    (tmp_path / "victim").mkdir()
    (tmp_path / "victim" / "front.npz").write_text("precious")
    (tmp_path / "out").mkdir()
    (tmp_path / "out" / "front.yaml").symlink_to(tmp_path / "victim" / "front.npz")
    with results_folder(tmp_path / "out") as folder:
        (folder / "front.yaml").write_text("mine")
    assert not (tmp_path / "out" / "front.yaml").is_symlink()
    (tmp_path / "out" / "observations").symlink_to(tmp_path / "victim")
    with pytest.raises(CalibrationError, match="observations is a link"):
        with results_folder(tmp_path / "out") as folder:
            (folder / "observations").mkdir()
            (folder / "observations" / "front.npz").write_text("mine")
    assert (tmp_path / "victim" / "front.npz").read_text() == "precious"


@pytest.mark.parametrize("link", [os.symlink, os.link])
def test_a_file_of_ones_own_is_never_anothers_file(tmp_path, link):
    (tmp_path / "victim").write_text("precious")
    link(tmp_path / "victim", tmp_path / ".detections.jsonl")
    with pytest.raises(OSError):
        open_own(tmp_path / ".detections.jsonl", truncate=True)
    os.mkfifo(tmp_path / "pipe")
    with pytest.raises(OSError):
        open_own(tmp_path / "pipe")
    assert (tmp_path / "victim").read_text() == "precious"


def test_what_killed_programs_unpacked_is_removed_and_what_lives_stays(tmp_path, monkeypatch):
    monkeypatch.setattr("tempfile.tempdir", str(tmp_path))
    script = (
        "import os, sys; from fisheye_ep_calib.storage.scratch import Scratch; s = Scratch(); print(s.path, flush=True)"
    )
    ended = subprocess.run(
        [sys.executable, "-c", f"{script}; os._exit(9)"],
        env={**os.environ, "TMPDIR": str(tmp_path)},
        stdout=-1,
        text=True,
    )
    left = tmp_path / ended.stdout.strip()
    assert (left / ".owner").exists()
    lives = Scratch()
    assert lives.path.exists() and left.exists()  # it may have been made just now
    for folder in (left, lives.path):
        os.utime(folder, (0, 0))
    (tmp_path / "fisheye_ep_calib_link").symlink_to("/")
    other = Scratch()
    assert other.path.exists() and not left.exists() and lives.path.exists()
    lives.close()
    other.close()
    assert [path.name for path in tmp_path.iterdir()] == ["fisheye_ep_calib_link"]


def test_a_place_that_cannot_be_written_is_one_line(tmp_path):
    (tmp_path / "file").write_text("")
    with pytest.raises(CalibrationError, match="cannot write"):
        with results_folder(tmp_path / "file"):
            pass
