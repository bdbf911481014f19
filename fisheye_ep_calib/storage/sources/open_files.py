"""Few files open at once, however many parts a recording has."""

from __future__ import annotations

import threading
from typing import Protocol

MAX_OPEN = 8


class Closeable(Protocol):
    def close(self) -> None: ...


class _InUse(threading.local):
    """Every thread has its own files, and closes no other's."""

    def __init__(self) -> None:
        self.sources: list[Closeable] = []  # the latest last


_in_use = _InUse()


def note_use(source: Closeable) -> None:
    """Remember that ``source`` has a file open; closes the one that has gone unused the longest."""
    forget(source)
    _in_use.sources.append(source)
    while len(_in_use.sources) > MAX_OPEN:
        _in_use.sources.pop(0).close()


def forget(source: Closeable) -> None:
    """The source has closed its file."""
    if source in _in_use.sources:
        _in_use.sources.remove(source)
