"""Files that are written whole or not at all."""

from __future__ import annotations

import contextlib
import os
import re
import secrets
from collections.abc import Iterator
from pathlib import Path
from typing import BinaryIO

from fisheye_ep_calib.errors import CalibrationError
from fisheye_ep_calib.outside import checked_path, other_than_a_file
from fisheye_ep_calib.storage.held import HAS_LOCKS, held_file, remove_dead_file

_MOST_WRITERS = 9  # at one time of one file; of more, what they leave when they are killed stays
_UNFINISHED = re.compile(r"\..+\.\d\.unfinished", re.DOTALL)


def atomic_write(path: str | os.PathLike[str], content: bytes) -> None:
    """Write ``content`` to ``path``: a reader sees the old file or the new one, never a part.

    Missing parent folders are created. Raises InputError where it is no path, CalibrationError where the place cannot
    be written.
    """
    with whole_file(path) as file:
        file.write(content)


@contextlib.contextmanager
def whole_file(path: str | os.PathLike[str]) -> Iterator[BinaryIO]:
    """A file to write into that takes the place of ``path`` when it is left without an exception.

    Until then it lies beside it under a hidden name; what a killed program left there is removed. Missing parent
    folders are created. Raises CalibrationError where the place cannot be written, or something else than a file is
    there: a rename would put a file in the place of /dev/null.
    """
    path = checked_path(path, "path")
    if other := other_than_a_file(path):
        raise CalibrationError(f"cannot write {path}: it is {other}, not a file; give another place")
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        temporary, file = _beside(path)
        with file:
            try:
                yield file
                file.flush()
                os.fsync(file.fileno())
                if not HAS_LOCKS:  # Windows renames no open file; elsewhere it is held until it has its name
                    file.close()
                os.replace(temporary, path)
            except BaseException:
                with contextlib.suppress(OSError):
                    temporary.unlink()
                raise
        _sync_folder(path.parent)
    except OSError as error:
        raise CalibrationError(f"cannot write {path}: {error.strerror or error}") from None


def remove_unfinished(folder: Path) -> None:
    """Remove what killed programs left of files in the folder and in those below it; links are not followed."""
    for place, _, names in os.walk(folder):
        for name in filter(_UNFINISHED.fullmatch, names):
            remove_dead_file(Path(place, name))


def _beside(path: Path) -> tuple[Path, BinaryIO]:
    """A new hidden file beside ``path``, as readable as any other of the user's. Raises OSError."""
    for number in range(1, _MOST_WRITERS + 1):
        temporary = path.with_name(f".{path.name}.{number}.unfinished")
        if (file := held_file(temporary)) is not None:
            return temporary, file
    temporary = path.with_name(f".{path.name}.{secrets.token_hex(8)}.unfinished")
    return temporary, open(temporary, "xb")


def _sync_folder(folder: Path) -> None:
    """Make the rename survive a power cut, where the file system lets a folder be synced."""
    try:
        descriptor = os.open(folder, os.O_RDONLY)
    except OSError:
        return
    try:
        os.fsync(descriptor)
    except OSError:
        pass
    finally:
        os.close(descriptor)
