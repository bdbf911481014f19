"""Text from outside, made fit to be printed: one line, of bounded length, without what drives a terminal."""

from __future__ import annotations

import os
import reprlib

LONGEST = 4000  # characters of a line that is printed

_REPR = reprlib.Repr()
_REPR.maxlevel, _REPR.maxlist, _REPR.maxtuple, _REPR.maxdict = 3, 4, 4, 3
_REPR.maxstring = _REPR.maxother = _REPR.maxlong = 60


def one_line(text: object, longest: int = LONGEST) -> str:
    """Control characters, line ends and what turns the direction of writing become escapes; the middle of a long text
    is left out."""
    line = os.fspath(text) if isinstance(text, os.PathLike) else str(text)
    if isinstance(line, bytes):
        line = line.decode("utf-8", "surrogateescape")
    if len(line) > longest:
        line = f"{line[: longest // 2]} … {line[-longest // 2 :]}"
    if line.isprintable():
        return line
    return "".join(character if character.isprintable() else _escaped(character) for character in line)


def printable(text: str) -> str:
    """As ``one_line`` of any length, with line ends and tabs kept: for a text of several lines."""
    if text.isprintable():
        return text
    return "".join(c if c.isprintable() or c in "\n\t" else _escaped(c) for c in text)


def shown(value: object) -> str:
    """A value that an error repeats, as Python writes it, in a few words."""
    return one_line(_REPR.repr(value))


def _escaped(character: str) -> str:
    return character.encode("unicode_escape").decode("ascii")
