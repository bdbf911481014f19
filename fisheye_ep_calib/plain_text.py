"""Text from outside, made fit to be printed: one line, of bounded length, without what drives a terminal."""

from __future__ import annotations

import contextlib
import os
import reprlib
import sys

TYPE_CHECKING = False  # typing would have to be imported before the command is in charge
if TYPE_CHECKING:
    from collections.abc import Iterator
    from typing import Any

_SPACES = "\u00a0\u2009\u202f"  # no-break, thin, and both; ``isprintable`` is false for them
LONGEST = 4000  # characters of a line that is printed

_REPR = reprlib.Repr()
_REPR.maxlevel, _REPR.maxlist, _REPR.maxtuple, _REPR.maxdict = 3, 4, 4, 3
_REPR.maxstring = _REPR.maxother = _REPR.maxlong = 60


def one_line(text: object, longest: int = LONGEST) -> str:
    """Control characters, line ends and what turns the direction of writing become escapes; the middle of a long text
    is left out."""
    if type(text) is str and len(text) <= longest and text.isprintable():  # most names of images
        return text
    line = os.fspath(text) if isinstance(text, os.PathLike) else str(text)
    if isinstance(line, bytes):
        line = line.decode("utf-8", "surrogateescape")
    if len(line) > longest:
        line = f"{line[: longest // 2]} … {line[-longest // 2 :]}"
    if line.isprintable():
        return line
    return "".join(character if _is_plain(character) else _escaped(character) for character in line)


def printable(text: str) -> str:
    """As ``one_line`` of any length, with line ends and tabs kept, and the return with which a progress bar begins."""
    if text.isprintable():
        return text
    start = "\r" if text.startswith("\r") else ""
    return start + "".join(c if _is_plain(c) or c in "\n\t" else _escaped(c) for c in text[len(start) :])


def shown(value: object) -> str:
    """A value that an error repeats, as Python writes it, in a few words."""
    return one_line(_REPR.repr(value))


def _is_plain(character: str) -> bool:
    """Whether it may be printed as it is; spaces that keep a number with its unit may."""
    return character.isprintable() or character in _SPACES


def _escaped(character: str) -> str:
    return character.encode("unicode_escape").decode("ascii")


class _PlainStream:
    """Writes what can be printed, and escapes the rest; otherwise the stream that it is made of."""

    def __init__(self, stream: Any) -> None:
        self._stream = stream

    def write(self, text: str) -> int:
        self._stream.write(printable(text))
        return len(text)

    def __getattr__(self, name: str) -> Any:
        return getattr(self._stream, name)


@contextlib.contextmanager
def plain_streams() -> Iterator[None]:
    """In here nothing from outside that is printed drives the terminal, or a log's reader's."""
    before = sys.stdout, sys.stderr
    sys.stdout, sys.stderr = _PlainStream(sys.stdout), _PlainStream(sys.stderr)
    try:
        yield
    finally:
        sys.stdout, sys.stderr = before
