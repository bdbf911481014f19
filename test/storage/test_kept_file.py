"""What counts as on the disk is what the disk holds, whatever was done to it behind the program's back."""

from __future__ import annotations

import shutil
from collections.abc import Callable
from pathlib import Path

import pytest

from fisheye_ep_calib.errors import CalibrationError
from fisheye_ep_calib.storage.kept_file import KeptFile


@pytest.fixture
def file(tmp_path: Path) -> KeptFile:
    return KeptFile(tmp_path / "results" / "front.npz")


def test_held_from_being_written_until_it_changes(file: KeptFile) -> None:
    assert not file.held and not file.gone
    file.write(b"views")
    assert file.held and file.path.read_bytes() == b"views"
    file.changed()
    assert not file.held and not file.gone


@pytest.mark.parametrize(
    "harm",
    [
        lambda path: path.unlink(),
        lambda path: shutil.rmtree(path.parent),
        lambda path: path.write_bytes(b""),
        lambda path: path.replace(path.with_name("elsewhere")),
        lambda path: (path.unlink(), path.write_bytes(b"other")),
    ],
    ids=["removed", "folder removed", "cut", "moved", "replaced"],
)
def test_what_is_done_to_it_is_seen_and_mended(file: KeptFile, harm: Callable[[Path], object]) -> None:
    file.write(b"views")
    harm(file.path)
    assert not file.held and file.gone
    file.write(b"views")
    assert file.held and file.path.read_bytes() == b"views"


def test_a_refused_write_is_not_held_though_an_earlier_one_is_there(file: KeptFile) -> None:
    file.write(b"early")
    file.path.unlink()
    file.path.mkdir()
    with pytest.raises(CalibrationError):
        file.write(b"late")
    assert not file.held


def test_what_was_read_counts_as_held(file: KeptFile) -> None:
    file.path.parent.mkdir()
    file.path.write_bytes(b"views")
    file.adopt()
    assert file.held
