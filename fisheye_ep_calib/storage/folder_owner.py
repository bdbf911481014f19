"""One folder of results has one program that writes into it."""

from __future__ import annotations

import contextlib
import os
import socket
import time
from pathlib import Path
from typing import BinaryIO

from fisheye_ep_calib.errors import CalibrationError
from fisheye_ep_calib.plain_text import one_line
from fisheye_ep_calib.storage.atomic import remove_unfinished
from fisheye_ep_calib.storage.held import LOCK, open_own

try:
    import fcntl
except ImportError:  # Windows has no such locks, and no node
    fcntl = None  # type: ignore[assignment]


class FolderOwner:
    """Holds a folder by a locked file in it that says who: the system lets go of it however the program ends.

    So the file of a program that died is taken over, and its process number may be anybody's by now. What it left of
    files that it was writing goes.
    """

    def __init__(self, folder: Path, program: str) -> None:
        """program: what others are told has the folder."""
        self.folder = folder
        self._program = program
        self._lock: BinaryIO | None = None
        self._made = False

    def hold(self) -> None:
        """Take the folder, making it where it is not there; at once where it is held already.

        Where the disk refuses, nothing is held: try again later. Raises CalibrationError where another program has it.
        """
        if fcntl is None or self._is_held():
            return
        self._let_go()
        with contextlib.suppress(OSError):
            self._made |= not self.folder.exists()
            self.folder.mkdir(parents=True, exist_ok=True)
            self._take()

    def release(self) -> None:
        """Let go of the folder; it goes too where it was made for this and holds nothing."""
        if self._is_held():
            with contextlib.suppress(OSError):
                self._path.unlink()
                if self._made:
                    self.folder.rmdir()
        self._let_go()

    @property
    def _path(self) -> Path:
        return self.folder / LOCK

    def _take(self) -> None:
        lock = open_own(self._path)
        try:
            fcntl.flock(lock, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError:
            lock.seek(0)
            who = one_line(lock.read(400).decode("utf-8", "replace").split("\n")[0])
            lock.close()
            raise CalibrationError(
                f"{self.folder} is in use by {who or 'another program'}: end that, or write into another folder"
            ) from None
        except OSError:  # a file system without locks
            lock.close()
            raise
        self._lock = lock
        if not self._is_held():  # whoever had it removed it meanwhile
            self._let_go()
            self._take()
            return
        lock.truncate(0)
        since = time.strftime("%Y-%m-%d %H:%M:%S")
        lock.write(f"{self._program}, process {os.getpid()} on {socket.gethostname()} since {since}\n".encode())
        lock.flush()
        remove_unfinished(self.folder)

    def _is_held(self) -> bool:
        """Whether the file that is locked is the one that others would find."""
        if self._lock is None:
            return False
        try:
            return os.path.samestat(os.fstat(self._lock.fileno()), self._path.stat())
        except OSError:
            return False

    def _let_go(self) -> None:
        lock, self._lock = self._lock, None
        if lock is not None:
            lock.close()
