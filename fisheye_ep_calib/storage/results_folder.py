"""A folder of results that appears whole or not at all."""

from __future__ import annotations

import contextlib
import itertools
import os
import secrets
import shutil
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path

from fisheye_ep_calib.errors import CalibrationError
from fisheye_ep_calib.outside import other_than_a_file
from fisheye_ep_calib.storage.held import held_folder, remove_dead_folder


@contextmanager
def results_folder(output: Path) -> Iterator[Path]:
    """A hidden folder in ``output`` to write into; left without an exception, its files join those of ``output``.

    Files of the same names are replaced, each whole; other files are left alone. Where nothing was written nothing
    appears. Raises CalibrationError where the place cannot be written.
    """
    made: list[Path] = []
    with contextlib.ExitStack() as at_the_end:
        at_the_end.callback(lambda: remove_empty(made))
        try:
            made = make_folder(output)
            joins = any(not path.name.startswith(".") for path in output.iterdir())
            _remove_abandoned(output)
            held, lock = held_folder(lambda: _new_folder(beside(output, f"{secrets.token_hex(8)}.unfinished")))
            at_the_end.enter_context(lock)
            at_the_end.callback(lambda: shutil.rmtree(held, ignore_errors=True))
            staging = _new_folder(held / "results")
            yield staging
            _publish(staging, output, joins)
        except OSError as error:
            raise CalibrationError(f"cannot write {output}: {error.strerror or error}") from None


def make_folder(path: Path) -> list[Path]:
    """Make a folder and those above it; those that were not there before, the innermost first."""
    made = [place for place in (path, *path.absolute().parents) if not place.exists()]
    path.mkdir(parents=True, exist_ok=True)
    return made


def remove_empty(folders: Sequence[Path]) -> None:
    """Remove the folders, the innermost first, as far as they are empty."""
    with contextlib.suppress(OSError):
        for folder in folders:
            folder.rmdir()


def nearest_folder(path: Path) -> Path:
    """The path itself where it is there, or else what is there that is nearest above it."""
    return next(place for place in (path, *path.absolute().parents) if place.exists())


def beside(output: Path, ending: str) -> Path:
    """A hidden path in ``output``, never above it: what lies there is somebody else's."""
    return output / f".{ending}"


def _new_folder(path: Path) -> Path:
    path.mkdir()
    return path


def _remove_abandoned(output: Path) -> None:
    """What killed programs have left of results that were to join those of ``output``."""
    for path in output.glob(f".{'[0-9a-f]' * 16}.unfinished"):
        remove_dead_folder(path)


def _refuse_blocked(destination: Path, output: Path) -> None:
    """Before the first file takes its place, so that all do or none. Raises CalibrationError."""
    for folder in [output / inner for inner in destination.relative_to(output).parents if inner != Path(".")]:
        if folder.is_symlink():
            raise CalibrationError(f"{folder} is a link: results are not written through it")
        if folder.exists() and not folder.is_dir():
            raise CalibrationError(f"cannot write {folder}: it is not a folder; give another place")
    if other := other_than_a_file(destination):
        raise CalibrationError(f"cannot write {destination}: it is {other}, not a file; give another place")


def _publish(staging: Path, output: Path, joins: bool) -> None:
    """Raises CalibrationError where another program has put the same there meanwhile; then they lie beside it."""
    written = sorted((path for path in staging.rglob("*") if path.is_file()), key=lambda path: -len(path.parts))
    places = [(path, output / path.relative_to(staging)) for path in written]
    for _, destination in places:
        _refuse_blocked(destination, output)
    if not joins and any(destination.exists() for _, destination in places):
        free = next(path for n in itertools.count(2) if not (path := output.with_name(f"{output.name}_{n}")).exists())
        os.rename(staging, free)
        raise CalibrationError(f"{output} has been made by another program; the results are in {free}")
    for path, destination in places:
        destination.parent.mkdir(parents=True, exist_ok=True)
        os.replace(path, destination)
