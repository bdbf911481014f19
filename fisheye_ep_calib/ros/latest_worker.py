"""A thread that works on the latest of what it is offered, so that whoever offers never waits."""

from __future__ import annotations

import threading
from collections.abc import Callable
from typing import Any


class LatestWorker:
    """One thread; what comes while it works replaces what waits. dropped: how many were replaced."""

    def __init__(self, work: Callable[[Any], None]) -> None:
        """work: called with each item that is its turn; must not raise."""
        self.dropped = 0
        self._work = work
        self._waiting: Any = None
        self._ended = False
        self._changed = threading.Condition()
        self._thread = threading.Thread(target=self._run, daemon=True, name="worker")
        self._thread.start()

    def offer(self, item: Any) -> None:
        """Returns at once."""
        with self._changed:
            self.dropped += self._waiting is not None
            self._waiting = item
            self._changed.notify()

    def close(self, patience: float = 1.0) -> None:
        """What is under way gets this many seconds to end."""
        with self._changed:
            self._ended = True
            self._changed.notify()
        self._thread.join(patience)

    def _run(self) -> None:
        while True:
            with self._changed:
                self._changed.wait_for(lambda: self._ended or self._waiting is not None)
                if self._ended:
                    return
                item, self._waiting = self._waiting, None
            self._work(item)
