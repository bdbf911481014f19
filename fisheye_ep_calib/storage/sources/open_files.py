"""Few files open at once, however many parts a recording has."""

from __future__ import annotations

from typing import Protocol

MAX_OPEN = 8


class Closeable(Protocol):
    def close(self) -> None: ...


_in_use: list[Closeable] = []  # the latest last


def note_use(source: Closeable) -> None:
    """Remember that ``source`` has a file open; closes the one that has gone unused the longest."""
    forget(source)
    _in_use.append(source)
    while len(_in_use) > MAX_OPEN:
        _in_use.pop(0).close()


def forget(source: Closeable) -> None:
    """The source has closed its file."""
    if source in _in_use:
        _in_use.remove(source)
