"""A board that is seen while the target is not: told before somebody looks for the fault elsewhere."""

from __future__ import annotations

import threading
import time
from collections.abc import Callable

from fisheye_ep_calib.live.frame import Sighting

MISSES = 5  # frames in a row without the target before another board is looked for
PAUSE = 4.0  # seconds between two such looks: each takes as long as a few frames


class OtherBoard:
    """Gathered from every frame that was searched; safe to use from several threads.

    A look that takes something else for a board takes the next image's for one of another size: what two looks in a row
    agree on is told.
    """

    def __init__(self, clock: Callable[[], float] = time.monotonic) -> None:
        self._clock = clock
        self._misses = 0
        self._asked: float | None = None
        self._last = ""
        self._told = ""
        self._lock = threading.Lock()

    @property
    def sentence(self) -> str:
        """What is seen in place of the target; empty while nothing is known to be."""
        return self._told

    def due(self) -> bool:
        """Whether the next frame is to be searched for other boards; counts as asked."""
        with self._lock:
            now = self._clock()
            if self._misses < MISSES or (self._asked is not None and now - self._asked < PAUSE):
                return False
            self._asked = now
            return True

    def take(self, sighting: Sighting) -> None:
        with self._lock:
            if len(sighting.detection):
                self._misses, self._last, self._told = 0, "", ""
                return
            self._misses += 1
            if sighting.other_board is None:
                return
            if sighting.other_board == self._last:
                self._told = self._last
            self._last = sighting.other_board

    def forget(self) -> None:
        with self._lock:
            self._misses, self._asked, self._last, self._told = 0, None, "", ""
