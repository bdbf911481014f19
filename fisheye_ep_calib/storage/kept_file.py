"""A file that ought to hold what a program keeps in memory, and whether it does."""

from __future__ import annotations

from pathlib import Path

from fisheye_ep_calib.storage.atomic import atomic_write


class KeptFile:
    """What was written stays written only while nobody removes, replaces or cuts it: ask ``held``.

    Not safe for several threads at a time; its owner locks.
    """

    def __init__(self, path: Path) -> None:
        self.path = path
        self._written: tuple[int, ...] | None = None

    def adopt(self) -> None:
        """What is in memory was read from the file as it is."""
        self._written = self._on_disk()

    def changed(self) -> None:
        """What is in memory has changed."""
        self._written = None

    def write(self, content: bytes) -> None:
        """Write what is in memory, whole or not at all. Raises CalibrationError, and the file is not held then."""
        self._written = None
        atomic_write(self.path, content)
        self._written = self._on_disk()

    @property
    def held(self) -> bool:
        """Whether the disk holds what is in memory; looks at the disk."""
        return self._written is not None and self._written == self._on_disk()

    @property
    def gone(self) -> bool:
        """Whether it was written and is there no longer; looks at the disk."""
        return self._written is not None and self._written != self._on_disk()

    def _on_disk(self) -> tuple[int, ...] | None:
        try:
            status = self.path.stat()
        except OSError:
            return None
        return status.st_ino, status.st_size, status.st_mtime_ns
