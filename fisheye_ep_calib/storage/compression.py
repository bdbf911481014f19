"""Decompression that never yields more than it is allowed to."""

from __future__ import annotations

import bz2
import io
import lzma
import shutil
import zlib
from collections.abc import Callable
from pathlib import Path
from typing import Any, BinaryIO

from fisheye_ep_calib.errors import InputError
from fisheye_ep_calib.outside import open_outside
from fisheye_ep_calib.plain_text import shown
from fisheye_ep_calib.storage.budget import Budget, Spent

ZSTD_MAGIC = b"\x28\xb5\x2f\xfd"
BLOCK = 2**22
SPARE_BYTES = 2**28  # that stay free on the disk
_PACKED_BLOCK = 2**16
_XZ_MAGIC = b"\xfd7zXZ\0"
_XZ_MEMORY = 2**27
_MEMBER_STARTS = (b"\x1f\x8b", b"BZh", _XZ_MAGIC)


def decompress(content: bytes, kind: str, limit: int) -> bytes:
    """``content`` compressed by kind "zstd", "lz4", "bz2" or not at all ("" or "none").

    Raises InputError where it is damaged or would hold more than ``limit`` bytes.
    """
    if kind in ("", "none"):
        return content
    if kind not in DECOMPRESSORS:
        raise InputError(f"the compression {shown(kind[:20])} is not known")
    try:
        data = DECOMPRESSORS[kind](content, limit + 1)
    except ModuleNotFoundError as error:
        raise InputError(f"{kind} needs the Python package {error.name}: pip install {error.name}") from None
    except Exception:  # each library has its own, and damaged bytes lead to all of them
        raise InputError(f"the {kind} data is damaged") from None
    if len(data) > limit:
        raise InputError(f"the {kind} data holds more than it declares")
    return data


def _zstd(content: bytes, limit: int) -> bytes:
    import zstandard

    if zstandard.frame_content_size(content) == limit - 1:  # the usual frame, which says how much it holds: one copy
        unpacked: bytes = zstandard.ZstdDecompressor().decompress(content)
        return unpacked
    reader = zstandard.ZstdDecompressor().stream_reader(content, read_across_frames=True)
    parts = []
    while limit > 0 and (part := reader.read(min(BLOCK, limit))):
        parts.append(part)
        limit -= len(part)
    return b"".join(parts)


def _lz4(content: bytes, limit: int) -> bytes:
    import lz4.frame

    context = lz4.frame.create_decompression_context()  # its class of decompressors copies what it is given
    result: bytes = lz4.frame.decompress_chunk(context, content, max_length=limit)[0]
    return result


def _bz2(content: bytes, limit: int) -> bytes:
    return bz2.BZ2Decompressor().decompress(content, max_length=limit)


DECOMPRESSORS = {"zstd": _zstd, "lz4": _lz4, "bz2": _bz2}


def decompress_file(source: Path, destination: Path, budget: Budget) -> str:
    """Decompress a .zstd file as far as it goes. Returns what went wrong in words, or an empty string.

    Raises InputError where the disk would fill up.
    """
    try:
        import zstandard
    except ModuleNotFoundError:
        raise InputError(f"{source}: reading it needs the Python package zstandard") from None
    budget.grow(source.stat().st_size)
    room = shutil.disk_usage(destination.parent).free - SPARE_BYTES
    with open_outside(source) as packed, open(destination, "xb") as unpacked:
        reader = zstandard.ZstdDecompressor().stream_reader(packed, read_across_frames=True)
        while True:
            try:
                part = reader.read(BLOCK)
                budget.take(len(part))
            except (zstandard.ZstdError, Spent) as error:
                reason = str(error) if isinstance(error, Spent) else "the compressed file is damaged"
                return f"{source}: {reason}; what precedes that is used"
            if not part:
                return ""
            room -= len(part)
            if room < 0:
                raise InputError(
                    f"{source}: no room to decompress it in {destination.parent}; set TMPDIR to a larger disk"
                )
            unpacked.write(part)


class UnpackedStream(io.RawIOBase):
    """The content of a gzip, bzip2, xz or plain file, read onward in blocks of bounded size; ``budget`` is told.

    Reading raises Spent, EOFError where the file is cut short, and what the packers' libraries raise.
    """

    def __init__(self, file: BinaryIO, budget: Budget) -> None:
        self._packed_file = file
        self._budget = budget
        start = file.read(len(_XZ_MAGIC))
        kinds = {b"\x1f\x8b": _gzip, b"BZh": bz2.BZ2Decompressor, _XZ_MAGIC: _xz}
        self._new: Callable[[], Any] | None = next((kinds[magic] for magic in kinds if start.startswith(magic)), None)
        self._unpacker: Any = None if self._new is None else self._new()
        self._packed = start

    def readable(self) -> bool:
        return True

    def readinto(self, buffer: Any) -> int:
        part = self._next(len(buffer))
        buffer[: len(part)] = part
        return len(part)

    def _next(self, most: int) -> bytes:
        """What the next packed bytes hold, at most so much; nothing at the end."""
        while True:
            if not self._packed and (self._unpacker is None or getattr(self._unpacker, "needs_input", True)):
                self._packed = self._packed_file.read(_PACKED_BLOCK)
                if not self._packed:
                    if self._unpacker is None or self._unpacker.eof:
                        return b""
                    raise EOFError("it is cut short")
            if self._unpacker is None:
                part, self._packed = self._packed[:most], self._packed[most:]
            else:
                part = self._unpack(most)
            self._budget.take(len(part))
            if part:
                return part

    def _unpack(self, most: int) -> bytes:
        assert self._new is not None
        if self._unpacker.eof:
            if not self._packed.startswith(_MEMBER_STARTS):
                self._packed = b""  # filling after the last member, as tar programs leave it
                return b""
            self._unpacker = self._new()
        part: bytes = self._unpacker.decompress(self._packed, most)
        left = self._unpacker.unused_data or getattr(self._unpacker, "unconsumed_tail", b"")
        self._packed = left
        return part


def _gzip() -> Any:
    return zlib.decompressobj(wbits=31)


def _xz() -> lzma.LZMADecompressor:
    return lzma.LZMADecompressor(memlimit=_XZ_MEMORY)
