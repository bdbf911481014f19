"""A folder of results appears whole or not at all."""

import os
import stat
import subprocess
import sys

import pytest

from fisheye_ep_calib.errors import CalibrationError
from fisheye_ep_calib.storage.atomic import atomic_write, remove_unfinished, whole_file
from fisheye_ep_calib.storage.held import open_own
from fisheye_ep_calib.storage.results_folder import beside, results_folder
from fisheye_ep_calib.storage.scratch import Scratch


def everything(folder):
    return sorted(str(path.relative_to(folder)) for path in folder.rglob("*"))


def test_a_new_folder_appears_with_all_its_files(tmp_path):
    output = tmp_path / "a" / "b"
    with results_folder(output) as folder:
        (folder / "observations").mkdir()
        (folder / "observations" / "front.npz").write_text("1")
        assert folder.parent.parent == output and folder.parent.name.startswith(".")
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


KILLED = """
import os, signal, sys
from pathlib import Path
from fisheye_ep_calib.storage.atomic import whole_file
from fisheye_ep_calib.storage.results_folder import results_folder
from fisheye_ep_calib.storage.scratch import Scratch
output, scratch = Path(sys.argv[1]), Scratch()
(scratch.path / "recording.db3").write_text("unpacked")
with results_folder(output) as folder, whole_file(output / "bag.mcap") as bag, whole_file(output / "images/1.png"):
    (folder / "front.yaml").write_text("half")
    bag.write(b"half")
    print("written", flush=True)
    sys.stdin.readline()
    os.kill(os.getpid(), signal.SIGKILL)
"""


@pytest.fixture
def writer(tmp_path, monkeypatch):
    """A process that writes into tmp_path/out, with tmp_path as its temporary folder, and kills itself when told."""
    pytest.importorskip("fcntl", reason="this system has no such locks")
    monkeypatch.setattr("tempfile.tempdir", str(tmp_path))
    environment = {**os.environ, "TMPDIR": str(tmp_path)}
    arguments = [sys.executable, "-c", KILLED, str(tmp_path / "out")]
    with subprocess.Popen(arguments, env=environment, stdin=-1, stdout=-1, text=True) as process:
        assert process.stdout.readline() == "written\n"
        yield process
        process.kill()


def write_all(tmp_path):
    with results_folder(tmp_path / "out") as folder:
        (folder / "rear.yaml").touch()
    with whole_file(tmp_path / "out" / "bag.mcap") as bag:
        bag.write(b"whole")
    remove_unfinished(tmp_path / "out")
    scratch = Scratch()
    assert scratch.path.exists()
    scratch.close()


def test_what_a_killed_program_left_goes_with_the_next_run(tmp_path, writer):
    before = everything(tmp_path)
    assert len([name for name in before if name.endswith(".unfinished")]) == 3
    write_all(tmp_path)
    lives = [name for name in everything(tmp_path) if name not in ("out/rear.yaml", "out/bag.mcap")]
    assert lives == before  # its program lives
    writer.communicate("now")
    (tmp_path / "victim").mkdir()
    (tmp_path / "victim" / ".owner").touch()
    for link in ("fisheye_ep_calib_abcdefgh", "out/.0123456789abcdef.unfinished", "out/.bag.mcap.2.unfinished"):
        (tmp_path / link).symlink_to(tmp_path / "victim")
    write_all(tmp_path)
    assert [name for name in everything(tmp_path) if not (tmp_path / name).is_symlink()] == [
        *("out", "out/bag.mcap", "out/images", "out/rear.yaml", "victim", "victim/.owner")
    ]
    assert (tmp_path / "out" / "bag.mcap").read_bytes() == b"whole"


def test_what_died_before_it_was_locked_goes_where_it_is_empty(tmp_path, monkeypatch):
    monkeypatch.setattr("tempfile.tempdir", str(tmp_path))
    for name, old in {"old_____": True, "young___": False, "in_use__": True}.items():
        folder = tmp_path / f"fisheye_ep_calib_{name}"
        folder.mkdir()
        if name == "in_use__":
            (folder / "mine").touch()
        if old:
            os.utime(folder, (0, 0))
    write_all(tmp_path)
    assert {path.name[-8:] for path in tmp_path.glob("fisheye*")} == {"young___", "in_use__"}


def test_several_write_one_file_at_a_time(tmp_path):
    with whole_file(tmp_path / "a") as first, whole_file(tmp_path / "a") as second:
        first.write(b"1")
        second.write(b"2")
    assert (tmp_path / "a").read_bytes() == b"1" and everything(tmp_path) == ["a"]
    with pytest.raises(ValueError), whole_file(tmp_path / "a") as third:
        third.write(b"3")
        raise ValueError
    assert (tmp_path / "a").read_bytes() == b"1" and everything(tmp_path) == ["a"]


def test_nothing_is_written_above_the_folder(tmp_path):
    assert beside(tmp_path / "a" / "b", "log") == tmp_path / "a" / "b" / ".log"
    with results_folder(tmp_path / "a" / "b") as folder:
        held = f"a/b/{folder.parent.name}"
        assert everything(tmp_path) == ["a", "a/b", held, f"{held}/.owner", f"{held}/{folder.name}"]
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


def test_a_place_that_cannot_be_written_is_one_line(tmp_path):
    (tmp_path / "file").write_text("")
    with pytest.raises(CalibrationError, match="cannot write"):
        with results_folder(tmp_path / "file"):
            pass


def test_nothing_but_a_file_is_replaced(tmp_path):
    """A rename would put a file in the place of /dev/null, where its user may do anything."""
    os.mkfifo(tmp_path / "pipe")
    (tmp_path / "to_pipe").symlink_to(tmp_path / "pipe")
    (tmp_path / "folder").mkdir()
    before = everything(tmp_path)
    for name, what in {"pipe": "a pipe", "to_pipe": "a pipe", "folder": "a folder"}.items():
        with pytest.raises(CalibrationError, match=f"{name}: it is {what}, not a file"), whole_file(tmp_path / name):
            raise AssertionError("begun to write")
    assert everything(tmp_path) == before and stat.S_ISFIFO((tmp_path / "pipe").lstat().st_mode)
    (tmp_path / "nowhere").symlink_to(tmp_path / "none")  # a link is replaced, not followed
    atomic_write(tmp_path / "nowhere", b"new")
    assert (tmp_path / "nowhere").read_bytes() == b"new" and not (tmp_path / "none").exists()


@pytest.mark.parametrize("blocked", ["b.yaml", "c"])
def test_where_one_file_cannot_take_its_place_none_does(tmp_path, blocked):
    """b.yaml is a folder, or the folder c a file."""
    (tmp_path / "b.yaml").mkdir() if blocked == "b.yaml" else (tmp_path / "c").write_text("mine")
    before = everything(tmp_path)
    with pytest.raises(CalibrationError, match=f"cannot write .*{blocked}"), results_folder(tmp_path) as folder:
        for name in ("a/1", "b.yaml", "c/2", "d"):
            (folder / name).parent.mkdir(exist_ok=True)
            (folder / name).write_text("new")
    assert everything(tmp_path) == before
