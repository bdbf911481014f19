"""A folder of results that appears whole or not at all."""

from __future__ import annotations

import contextlib
import itertools
import os
import re
import shutil
import time
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path

from fisheye_ep_calib.errors import CalibrationError

_ABANDONED_SECONDS = 3600


@contextmanager
def results_folder(output: Path) -> Iterator[Path]:
    """A hidden folder in ``output`` to write into; left without an exception, its files join those of ``output``.

    Files of the same names are replaced, each whole; other files are left alone. Where nothing was written nothing
    appears. Raises CalibrationError where the place cannot be written.
    """
    staging = beside(output, f"{os.getpid()}.unfinished")
    made: list[Path] = []
    try:
        made = make_folder(output)
        joins = any(not path.name.startswith(".") for path in output.iterdir())
        _remove_abandoned(staging)
        staging.mkdir()
        yield staging
        _publish(staging, output, joins)
    except OSError as error:
        raise CalibrationError(f"cannot write {output}: {error.strerror or error}") from None
    finally:
        shutil.rmtree(staging, ignore_errors=True)
        remove_empty(made)


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


def _remove_abandoned(staging: Path) -> None:
    """What processes that were killed have left of folders for the same results; another machine's may be young."""
    head = staging.name.removesuffix(f"{os.getpid()}.unfinished")
    for path in staging.parent.iterdir():
        match = re.fullmatch(re.escape(head) + r"(\d{1,9})\.unfinished", path.name, re.ASCII)
        if not match or not path.is_dir() or path.is_symlink():
            continue
        own = int(match[1]) == os.getpid()
        old = time.time() - path.stat().st_mtime > _ABANDONED_SECONDS
        if own or (old and not _process_lives(int(match[1]))):
            shutil.rmtree(path, ignore_errors=True)


def _process_lives(number: int) -> bool:
    """Whether a process of this machine has the number; where that cannot be told, it is taken to live."""
    if os.name != "posix":
        return True
    try:
        os.kill(number, 0)
    except ProcessLookupError:
        return False
    except OSError:
        pass
    return True


def _publish(staging: Path, output: Path, joins: bool) -> None:
    """Raises CalibrationError where another program has put the same there meanwhile; then they lie beside it."""
    written = sorted((path for path in staging.rglob("*") if path.is_file()), key=lambda path: -len(path.parts))
    places = [(path, output / path.relative_to(staging)) for path in written]
    for _, destination in places:
        for folder in destination.relative_to(output).parents:
            if (output / folder).is_symlink() and folder != Path("."):
                raise CalibrationError(f"{output / folder} is a link: results are not written through it")
    if not joins and any(destination.exists() for _, destination in places):
        free = next(path for n in itertools.count(2) if not (path := output.with_name(f"{output.name}_{n}")).exists())
        os.rename(staging, free)
        raise CalibrationError(f"{output} has been made by another program; the results are in {free}")
    for path, destination in places:
        destination.parent.mkdir(parents=True, exist_ok=True)
        os.replace(path, destination)
