"""A folder of results that appears whole or not at all."""

from __future__ import annotations

import errno
import itertools
import os
import re
import shutil
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from fisheye_ep_calib.errors import CalibrationError

_ABANDONED_SECONDS = 3600


@contextmanager
def results_folder(output: Path) -> Iterator[Path]:
    """A hidden folder to write into; left without an exception, it becomes ``output``, or its files join those there.

    Files of the same names are replaced, each whole; other files are left alone. Where nothing was written nothing
    appears. Raises CalibrationError where the place cannot be written.
    """
    staging, joins = beside(output, f"{os.getpid()}.unfinished"), output.exists()
    try:
        _remove_abandoned(staging)
        staging.mkdir()
        yield staging
        _publish(staging, output, joins)
    except OSError as error:
        raise CalibrationError(f"cannot write {output}: {error.strerror or error}") from None
    finally:
        shutil.rmtree(staging, ignore_errors=True)


def nearest_folder(path: Path) -> Path:
    """The path itself where it is there, or else what is there that is nearest above it."""
    return next(place for place in (path, *path.absolute().parents) if place.exists())


def beside(output: Path, ending: str) -> Path:
    """A hidden path on ``output``'s file system that can be used before ``output`` is there: no folder need be made.

    It lies in ``output`` where that is there already, and else in the nearest folder above it.
    """
    there = nearest_folder(output)
    steps = output.absolute().parts[len(there.absolute().parts) :]
    return there / ".".join(["", *steps, ending])


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
    written = sorted((path for path in staging.rglob("*") if path.is_file()), key=lambda path: -len(path.parts))
    if not written:
        return
    if not joins:
        output.parent.mkdir(parents=True, exist_ok=True)
        _rename(staging, output)
        return
    for path in written:
        destination = output / path.relative_to(staging)
        destination.parent.mkdir(parents=True, exist_ok=True)
        os.replace(path, destination)


def _rename(staging: Path, output: Path) -> None:
    """Raises CalibrationError where another program has made the folder meanwhile; the results then have another."""
    try:
        os.rename(staging, output)
    except OSError as error:
        if error.errno not in (errno.EEXIST, errno.ENOTEMPTY, errno.ENOTDIR):
            raise
        free = next(path for n in itertools.count(2) if not (path := output.with_name(f"{output.name}_{n}")).exists())
        os.rename(staging, free)
        raise CalibrationError(f"{output} has been made by another program; the results are in {free}") from None
