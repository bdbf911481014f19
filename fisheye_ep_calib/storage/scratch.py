"""Folders in the temporary folder that go with the program that made them, however it ends."""

from __future__ import annotations

import contextlib
import os
import shutil
import stat
import tempfile
import time
from pathlib import Path
from typing import BinaryIO

from fisheye_ep_calib.storage.atomic import open_own

try:
    import fcntl
except ImportError:  # Windows removes what a killed program left by its own means, or not at all
    fcntl = None  # type: ignore[assignment]

PREFIX = "fisheye_ep_calib_"
LOCK = ".owner"
_YOUNG_SECONDS = 60.0  # a folder without a lock was made just now, or is an older version's


class Scratch:
    """A folder of this program's own, made when it is first asked for; its lock tells that the program lives.

    Making one removes what killed programs left.
    """

    def __init__(self) -> None:
        self._path: Path | None = None
        self._lock: BinaryIO | None = None

    @property
    def path(self) -> Path:
        if self._path is None:
            remove_abandoned(Path(tempfile.gettempdir()))
            self._path = Path(tempfile.mkdtemp(prefix=PREFIX))
            self._lock = open_own(self._path / LOCK)
            if fcntl is not None:
                with contextlib.suppress(OSError):  # a file system without locks
                    fcntl.flock(self._lock, fcntl.LOCK_EX | fcntl.LOCK_NB)
        return self._path

    def close(self) -> None:
        """Remove the folder with all that is in it."""
        path, self._path = self._path, None
        lock, self._lock = self._lock, None
        if path is not None:
            shutil.rmtree(path, ignore_errors=True)
        if lock is not None:
            lock.close()

    def __del__(self) -> None:
        self.close()


def remove_abandoned(folder: Path) -> None:
    """Remove the scratch folders of this user in ``folder`` whose programs live no longer."""
    if fcntl is None:
        return
    with contextlib.suppress(OSError):
        for path in folder.glob(f"{PREFIX}*"):
            with contextlib.suppress(OSError):
                _remove_if_abandoned(path)


def _remove_if_abandoned(path: Path) -> None:
    status = path.lstat()
    if not stat.S_ISDIR(status.st_mode) or status.st_uid != os.getuid():
        return
    if not (path / LOCK).exists() or time.time() - status.st_mtime < _YOUNG_SECONDS:
        return
    with open_own(path / LOCK) as lock:
        fcntl.flock(lock, fcntl.LOCK_EX | fcntl.LOCK_NB)  # raises OSError where its program lives
        shutil.rmtree(path, ignore_errors=True)
