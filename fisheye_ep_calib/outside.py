"""The one way to open what comes from outside: regular files alone, bounded while they are read, faults in one line."""

from __future__ import annotations

import errno
import os
import stat
from collections.abc import Iterable
from os import PathLike
from pathlib import Path
from typing import BinaryIO

from fisheye_ep_calib.errors import InputError
from fisheye_ep_calib.plain_text import one_line, shown

_FLAGS = os.O_RDONLY
for _name in ("O_NONBLOCK", "O_NOCTTY", "O_CLOEXEC", "O_BINARY"):  # a pipe nobody writes to is opened at once
    _FLAGS |= getattr(os, _name, 0)
_BLOCK = 2**20
_SLOW_KINDS = {
    stat.S_IFIFO: "a pipe",
    stat.S_IFCHR: "a device",
    stat.S_IFBLK: "a device",
    stat.S_IFSOCK: "a socket",
}


def checked_path(path: object, name: str, kind: str = "file") -> Path:
    """The path that a parameter of this name was given; an empty text is none. Raises InputError."""
    if isinstance(path, str | PathLike) and isinstance(text := os.fspath(path), str) and text and "\0" not in text:
        return Path(text)
    raise InputError(f"`{name}` must be the path of a {kind}, not {shown(path)}")


def checked_paths(paths: object, name: str) -> list[Path]:
    """One path or several, as ``checked_path``. Raises InputError."""
    several = paths if isinstance(paths, Iterable) and not isinstance(paths, str | bytes | PathLike) else [paths]
    return [checked_path(path, name) for path in several]


def expanded(path: str | PathLike[str]) -> Path:
    """The path with the home folder in the place of ~; as it is where nobody is called so."""
    return Path(os.path.expanduser(path))


def real_path(path: str | PathLike[str]) -> Path:
    """The path without links, as far as it leads; a link to itself is left where it is."""
    return Path(os.path.realpath(path))


def other_than_a_file(path: str | PathLike[str]) -> str:
    """What lies there, or where a link leads: "a folder", "a device"; empty for a file and for nothing."""
    try:
        mode = os.stat(path).st_mode
    except (OSError, ValueError):
        return ""
    if stat.S_ISREG(mode):
        return ""
    return "a folder" if stat.S_ISDIR(mode) else _special(mode)


def open_outside(path: str | PathLike[str], kind: str = "") -> BinaryIO:
    """A regular file, or a link to one, open for reading bytes. kind: what it should be ("target"), for the error.

    Pipes, devices, sockets and folders are refused without waiting for them. Raises InputError.
    """
    descriptor, _ = _descriptor(path, kind)
    try:
        return os.fdopen(descriptor, "rb")
    except BaseException:
        os.close(descriptor)
        raise


def read_outside(path: str | PathLike[str], most: int, kind: str = "") -> bytes:
    """The content of a regular file of at most ``most`` bytes, however large it says it is. Raises InputError."""
    descriptor, size = _descriptor(path, kind)
    try:
        content = os.read(descriptor, min(most, size) + 1)
        if len(content) != size or size == 0:  # it grows or shrinks, is larger than one call reads, or lies in /proc
            while len(content) <= most and (more := os.read(descriptor, min(most + 1 - len(content), _BLOCK))):
                content += more
    except OSError as error:
        raise InputError(f"{_cannot(path, kind)}: {error.strerror or error}") from None
    finally:
        os.close(descriptor)
    if len(content) > most:
        raise InputError(f"{one_line(path)}: too large{f' for a {kind} file' if kind else ''}, at most {most} bytes")
    return content


def read_text_outside(path: str | PathLike[str], most: int, kind: str = "") -> str:
    """The text of a regular file in UTF-8, with or without a mark of it. Raises InputError."""
    try:
        return read_outside(path, most, kind).decode("utf-8-sig")
    except UnicodeDecodeError as error:
        raise InputError(f"{_cannot(path, kind)}: it is no text in UTF-8 (byte {error.start})") from None


def _descriptor(path: str | PathLike[str], kind: str) -> tuple[int, int]:
    """Of a regular file, open for reading, and how many bytes it says it has. Raises InputError."""
    try:
        _refuse_special(path, os.stat(path).st_mode, kind)  # opening a device may already do something
        descriptor = os.open(path, _FLAGS)
    except (OSError, ValueError) as error:  # a name may hold a zero byte
        raise InputError(f"{_cannot(path, kind)}: {getattr(error, 'strerror', None) or error}") from None
    try:
        status = os.fstat(descriptor)
        _refuse_special(path, status.st_mode, kind)
        return descriptor, status.st_size
    except BaseException:
        os.close(descriptor)
        raise


def _refuse_special(path: str | PathLike[str], mode: int, kind: str) -> None:
    if stat.S_ISDIR(mode):
        raise InputError(f"{_cannot(path, kind)}: {os.strerror(errno.EISDIR)}")
    if not stat.S_ISREG(mode):
        raise InputError(f"{_cannot(path, kind)}: it is {_special(mode)}, not a file")


def _special(mode: int) -> str:
    return _SLOW_KINDS.get(stat.S_IFMT(mode), "no regular file")


def _cannot(path: str | PathLike[str], kind: str) -> str:
    return f"cannot read {f'{kind} file ' if kind else ''}{one_line(path)}"
