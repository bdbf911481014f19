"""A folder has one owner among real processes, and a dead one does not stand in the way."""

from __future__ import annotations

import os
import shutil
import signal
import socket
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

import pytest

from fisheye_ep_calib.errors import CalibrationError
from fisheye_ep_calib.storage.folder_owner import LOCK, FolderOwner

pytest.importorskip("fcntl", reason="this system has no such locks")

HOLDER = """
import sys, time
from fisheye_ep_calib.storage.folder_owner import FolderOwner
from pathlib import Path
owner = FolderOwner(Path(sys.argv[1]), "another program")
owner.hold()
print("held", flush=True)
time.sleep(60)
"""


@pytest.fixture
def other(tmp_path: Path) -> Iterator[subprocess.Popen[str]]:
    """A process that holds the folder."""
    with subprocess.Popen([sys.executable, "-c", HOLDER, str(tmp_path)], stdout=subprocess.PIPE, text=True) as process:
        assert process.stdout is not None and process.stdout.readline() == "held\n"
        yield process
        process.kill()


def test_the_second_is_told_who_the_first_is(tmp_path: Path, other: subprocess.Popen[str]) -> None:
    with pytest.raises(CalibrationError) as refusal:
        FolderOwner(tmp_path, "me").hold()
    told = str(refusal.value)
    assert f"another program, process {other.pid} on {socket.gethostname()}" in told and "\n" not in told
    assert refusal.value.exit_code == 1


@pytest.mark.parametrize("number", [signal.SIGKILL, signal.SIGTERM])
def test_what_a_dead_one_left_is_taken_over(tmp_path: Path, other: subprocess.Popen[str], number: int) -> None:
    other.send_signal(number)
    other.wait(10)
    assert (tmp_path / LOCK).exists()
    owner = FolderOwner(tmp_path, "me")
    owner.hold()
    assert (tmp_path / LOCK).read_text().startswith(f"me, process {os.getpid()} on ")
    owner.release()
    assert not (tmp_path / LOCK).exists() and tmp_path.exists()


def test_a_folder_made_for_it_goes_if_nothing_came_into_it(tmp_path: Path) -> None:
    for name, content in (("empty", ""), ("full", "views")):
        owner = FolderOwner(tmp_path / name, "me")
        owner.hold()
        if content:
            (tmp_path / name / "front.npz").write_text(content)
        owner.release()
    assert [path.name for path in tmp_path.iterdir()] == ["full"]


def test_a_removed_folder_is_held_again_or_seen_to_be_lost(tmp_path: Path) -> None:
    folder = tmp_path / "results"
    first, second = FolderOwner(folder, "first"), FolderOwner(folder, "second")
    first.hold()
    shutil.rmtree(folder)
    first.hold()
    with pytest.raises(CalibrationError, match="first"):
        second.hold()
    shutil.rmtree(folder)
    second.hold()
    with pytest.raises(CalibrationError, match="second"):
        first.hold()
    first.release()
    assert (folder / LOCK).exists()  # that of the second
    second.release()


def test_where_no_folder_can_be_made_nothing_is_held_until_it_can(tmp_path: Path) -> None:
    folder = tmp_path / "results"
    folder.write_text("a file where the folder should be")
    owner = FolderOwner(folder, "me")
    owner.hold()
    folder.unlink()
    owner.hold()
    with pytest.raises(CalibrationError, match="me, process"):
        FolderOwner(folder, "other").hold()
    owner.release()
