"""Decoders tell stderr what they think of a damaged image, past Python; here it is told in one line instead."""

from __future__ import annotations

import contextlib
import functools
import os
from collections.abc import Iterator

import cv2

_STDERR = 2


@contextlib.contextmanager
def quiet_libraries() -> Iterator[None]:
    """In here OpenCV logs nothing, and nothing reaches stderr: libpng and libjpeg write there by themselves.

    What another thread writes to stderr in these milliseconds is lost too.
    """
    logs = cv2.utils.logging
    level = logs.getLogLevel()
    logs.setLogLevel(logs.LOG_LEVEL_SILENT)
    kept = _replaced_stderr()
    try:
        yield
    finally:
        if kept is not None:
            os.dup2(kept, _STDERR)
            os.close(kept)
        logs.setLogLevel(level)


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
