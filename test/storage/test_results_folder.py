"""A folder of results appears whole or not at all."""

import os
import stat
import subprocess
import sys

import pytest

from fisheye_ep_calib.errors import CalibrationError
from fisheye_ep_calib.storage.results_folder import beside, results_folder


def everything(folder):
    return sorted(str(path.relative_to(folder)) for path in folder.rglob("*"))


def test_a_new_folder_appears_with_all_its_files(tmp_path):
    output = tmp_path / "a" / "b"
    with results_folder(output) as folder:
        (folder / "observations").mkdir()
        (folder / "observations" / "front.npz").write_text("1")
        assert everything(tmp_path) == [folder.name, f"{folder.name}/observations"] + [
            f"{folder.name}/observations/front.npz"
        ]
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
            (tmp_path / "out").mkdir()
            (tmp_path / "out" / "front.yaml").write_text("theirs")
    assert (tmp_path / "out" / "front.yaml").read_text() == "theirs"
    assert (tmp_path / "out_2" / "front.yaml").read_text() == "mine"


@pytest.mark.skipif(os.name != "posix", reason="asks for processes")
@pytest.mark.parametrize("there", [False, True])
def test_what_killed_processes_left_of_the_folder_is_removed(tmp_path, there):
    output = tmp_path / "out"
    place, head = (output, ".") if there else (tmp_path, ".out.")
    place.mkdir(exist_ok=True)
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


def test_what_lies_beside_a_folder_needs_no_new_one(tmp_path, monkeypatch):
    assert beside(tmp_path / "a" / "b", "log") == tmp_path / ".a.b.log"
    assert beside(tmp_path, "log") == tmp_path / ".log"
    monkeypatch.chdir(tmp_path)
    assert beside(type(tmp_path)("a"), "log") == tmp_path / ".a.log"


def test_a_place_that_cannot_be_written_is_one_line(tmp_path):
    (tmp_path / "file").write_text("")
    with pytest.raises(CalibrationError, match="cannot write"):
        with results_folder(tmp_path / "file"):
            pass
