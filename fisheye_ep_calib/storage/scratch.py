"""Folders in the temporary folder that go with the program that made them, however it ends."""

from __future__ import annotations

import contextlib
import shutil
import tempfile
from pathlib import Path
from typing import BinaryIO

from fisheye_ep_calib.storage.held import held_folder, remove_dead_folder

PREFIX = "fisheye_ep_calib_"


class Scratch:
    """A folder of this program's own, made when it is first asked for.

    Making one removes what killed programs left.
    """

    def __init__(self) -> None:
        self._path: Path | None = None
        self._lock: BinaryIO | None = None

    @property
    def path(self) -> Path:
        if self._path is None:
            remove_abandoned(Path(tempfile.gettempdir()))
            self._path, self._lock = held_folder(lambda: Path(tempfile.mkdtemp(prefix=PREFIX)))
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
    with contextlib.suppress(OSError):
        for path in folder.glob(f"{PREFIX}{'[a-z0-9_]' * 8}"):
            remove_dead_folder(path)
