"""Says each thing once, until it is over and starts again."""

from __future__ import annotations

import threading
import time
from collections.abc import Callable


class Announcer:
    """Passes texts on to a log; a warning that is still standing is not repeated."""

    def __init__(
        self,
        info: Callable[[str], None],
        warning: Callable[[str], None],
        clock: Callable[[], float] = time.monotonic,
    ) -> None:
        self._info, self._warning, self._clock = info, warning, clock
        self._standing: dict[str, str] = {}
        self._last: dict[str, float] = {}  # when a warning that stands had its cause for the last time
        self._told: set[str] = set()
        self._lock = threading.Lock()

    def info(self, text: str) -> None:
        self._info(text)

    def warning(self, text: str) -> None:
        self._warning(text)

    def mention(self, key: str, text: str) -> None:
        """Warn of something that may come again and again: the first time only."""
        with self._lock:
            told = key in self._told
            self._told.add(key)
        if not told:
            self._warning(text)

    def warn_once(self, key: str, text: str) -> None:
        """Warn unless a warning with this key stands already; say what ends it with ``over``."""
        with self._lock:
            standing = key in self._standing
            self._standing.setdefault(key, text)
            self._last[key] = self._clock()
        if not standing:
            self._warning(text)

    def over(self, key: str, text: str = "", calm: float = 0.0) -> None:
        """The warning's cause is gone; ``text`` is said if it stood.

        calm: seconds since the last such cause, before which the warning stands on: what comes and goes is one thing.
        """
        with self._lock:
            if self._clock() - self._last.get(key, -calm) < calm:
                return
            stood = self._standing.pop(key, None)
        if stood is not None and text:
            self._info(text)

    def standing(self) -> dict[str, str]:
        """Warnings whose cause has not been seen to end, by key."""
        with self._lock:
            return dict(self._standing)
