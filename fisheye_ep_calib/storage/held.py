"""Unfinished files and folders that a program holds while it lives, by a lock; what dead ones left is removed.

The system lets go of a lock however a program ends. Who made something looks, once it has locked it, whether it is
still there under its name; who removes something locks it first: so nothing is lost between making and locking.
"""

from __future__ import annotations

import contextlib
import errno
import os
import shutil
import stat
import time
from collections.abc import Callable
from pathlib import Path
from typing import BinaryIO

try:
    import fcntl
except ImportError:  # Windows has no such locks: there nothing is known to be left by dead programs
    fcntl = None  # type: ignore[assignment]

HAS_LOCKS = fcntl is not None
LOCK = ".owner"
_YOUNG_SECONDS = 60.0  # a folder without a lock was made just now


def open_own(path: str | os.PathLike[str], truncate: bool = False, make: bool = True) -> BinaryIO:
    """A file of this program's own, open for reading and appending; never through a link.

    truncate: begin it anew. make: make it where it is not there. Raises OSError, also where the path is a link or
    another name of somebody's file.
    """
    descriptor = os.open(path, os.O_RDWR | os.O_APPEND | (os.O_CREAT if make else 0) | _flags(), 0o666)
    try:
        status = os.fstat(descriptor)
        if not stat.S_ISREG(status.st_mode) or status.st_nlink > 1:
            raise OSError(errno.EPERM, "it is another name of a file that is not this program's", os.fspath(path))
        if truncate:
            os.ftruncate(descriptor, 0)
        return os.fdopen(descriptor, "a+b")
    except BaseException:
        os.close(descriptor)
        raise


def held_file(path: Path) -> BinaryIO | None:
    """A new file, open for writing and held; None where the name is taken by a living program, or by no file.

    What a dead program left under the name is removed. Raises OSError.
    """
    while True:
        try:
            descriptor = os.open(path, os.O_WRONLY | os.O_CREAT | os.O_EXCL | _flags(), 0o666)
        except FileExistsError:
            if not remove_dead_file(path):
                return None
            continue
        file = os.fdopen(descriptor, "wb")
        if _lock(file) and _is_named(file, path):
            return file
        file.close()


def remove_dead_file(path: Path) -> bool:
    """Remove the file where no program holds it; whether there is none under this name now. Links are left."""
    try:
        with open_own(path, make=False) as file:
            if not _is_dead(file) or not _is_named(file, path):
                return False
            path.unlink()
    except FileNotFoundError:
        return True
    except OSError:
        return False
    return True


def held_folder(make: Callable[[], Path]) -> tuple[Path, BinaryIO]:
    """A folder that ``make`` makes, and the lock that holds it until it is closed. Raises OSError."""
    while True:
        path = make()
        with contextlib.suppress(FileNotFoundError):  # somebody took it for one that was left
            lock = open_own(path / LOCK)
            if _lock(lock) and _is_named(lock, path / LOCK):
                return path, lock
            lock.close()


def remove_dead_folder(path: Path) -> None:
    """Remove a folder of this user's that no program holds. Links are left, and what has no lock but is in use."""
    with contextlib.suppress(OSError):
        status = path.lstat()
        if not stat.S_ISDIR(status.st_mode) or (hasattr(os, "getuid") and status.st_uid != os.getuid()):
            return
        try:
            lock = open_own(path / LOCK, make=False)
        except FileNotFoundError:  # its program died before it had locked it, or is about to
            if time.time() - status.st_mtime > _YOUNG_SECONDS:
                path.rmdir()  # only where it is empty
            return
        with lock:
            if _is_dead(lock):
                shutil.rmtree(path)  # through no link


def _flags() -> int:
    flags = 0
    for name in ("O_NOFOLLOW", "O_NONBLOCK", "O_CLOEXEC", "O_BINARY"):
        flags |= getattr(os, name, 0)
    return flags


def _lock(file: BinaryIO) -> bool:
    """Hold the file for as long as it is open; False where somebody is removing it."""
    if fcntl is not None:
        try:
            fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError:
            return False
        except OSError:  # a file system without locks: nobody will take it for a dead program's
            pass
    return True


def _is_dead(file: BinaryIO) -> bool:
    """Whether nobody holds the file, as far as that can be told; it is held then."""
    if fcntl is None:
        return False
    try:
        fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except OSError:
        return False
    return True


def _is_named(file: BinaryIO, path: Path) -> bool:
    """Whether the file is still there under this name."""
    try:
        return os.path.samestat(os.fstat(file.fileno()), path.lstat())
    except OSError:
        return False
