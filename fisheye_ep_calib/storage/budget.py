"""What listing a recording may cost, before any image of it has been seen: bytes, entries and processor time.

Limits of a single record do not hold a file that repeats them: an index of a few bytes may point ten thousand times
at one megabyte, and a packed kilobyte may hold a gigabyte of nothing.
"""

from __future__ import annotations

import time

_FREE_BYTES = 2**29
_BYTES_A_BYTE = 50  # recordings are not packed more densely
_ENTRY = 4096  # bytes that a place in an index counts as: no image takes less than a fiftieth of it
_SECONDS = 8.0  # of processor time without a new image
_SECONDS_A_BYTE = 1 / 50e6


class Spent(Exception):
    """The budget is used up. What was reached by then is good; the message says what is not."""


class Budget:
    """Of one recording; grows with the size of its files."""

    def __init__(self) -> None:
        self._bytes = float(_FREE_BYTES)
        self._seconds = _SECONDS
        self._since: float | None = None  # of the first look at the clock after the last image

    def grow(self, size: int) -> None:
        """A file of so many bytes belongs to the recording."""
        self._bytes += _BYTES_A_BYTE * size
        self._seconds += _SECONDS_A_BYTE * size
        self._since = None

    @property
    def bytes_left(self) -> int:
        return max(0, int(self._bytes))

    def take(self, size: int) -> None:
        """So many bytes were unpacked. Raises Spent."""
        self._bytes -= size
        if self._bytes < 0:
            raise Spent("it unpacks to far more than recordings do")
        now = time.process_time()
        if self._since is None:
            self._since = now
        if now - self._since > self._seconds:
            raise Spent(f"{self._seconds:.0f} s of reading led to no further image")

    def enter(self, images: int = 1) -> None:
        """So many images were found. Raises Spent."""
        self._since = None
        self._bytes -= _ENTRY * images
        if self._bytes < 0:
            raise Spent("its index names more images than it has room for")
