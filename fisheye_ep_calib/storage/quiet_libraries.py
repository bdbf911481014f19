"""Decoders tell stderr what they think of a damaged image, past Python; here it is told in one line instead."""

from __future__ import annotations

import functools
import os

_STDERR = 2


class quiet_libraries:  # noqa: N801  # used as a function, once an image, where a generator would cost more
    """In here nothing reaches stderr: OpenCV logs its warnings there, libpng and libjpeg write by themselves.

    What another thread writes to stderr in these milliseconds is lost too.
    """

    def __enter__(self) -> None:
        self._kept = _replaced_stderr()

    def __exit__(self, *_: object) -> None:
        if self._kept is not None:
            os.dup2(self._kept, _STDERR)
            os.close(self._kept)


def _replaced_stderr() -> int | None:
    """A copy of the stderr that now leads nowhere; None where there is none to replace."""
    try:
        kept = os.dup(_STDERR)
    except OSError:
        return None
    os.dup2(_nowhere(), _STDERR)
    return kept


@functools.cache
def _nowhere() -> int:
    return os.open(os.devnull, os.O_WRONLY)
