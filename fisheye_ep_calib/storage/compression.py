"""Decompression that never yields more than it is allowed to."""

from __future__ import annotations

import bz2
import shutil
from pathlib import Path

import lz4.frame
import zstandard

from fisheye_ep_calib.errors import InputError

ZSTD_MAGIC = b"\x28\xb5\x2f\xfd"
BLOCK = 2**22


def decompress(content: bytes, kind: str, limit: int) -> bytes:
    """``content`` compressed by kind "zstd", "lz4", "bz2" or not at all ("" or "none").

    Raises InputError where it is damaged or would hold more than ``limit`` bytes.
    """
    if kind in ("", "none"):
        return content
    try:
        if kind == "zstd":
            data = _zstd(content, limit + 1)
        elif kind == "lz4":
            data = lz4.frame.LZ4FrameDecompressor().decompress(content, max_length=limit + 1)
        elif kind == "bz2":
            data = bz2.BZ2Decompressor().decompress(content, max_length=limit + 1)
        else:
            raise InputError(f"the compression {kind[:20]!r} is not known")
    except (zstandard.ZstdError, RuntimeError, OSError, EOFError, ValueError, MemoryError):
        raise InputError(f"the {kind} data is damaged") from None
    if len(data) > limit:
        raise InputError(f"the {kind} data holds more than it declares")
    return data


def _zstd(content: bytes, limit: int) -> bytes:
    reader = zstandard.ZstdDecompressor().stream_reader(content, read_across_frames=True)
    parts = []
    while limit > 0 and (part := reader.read(min(BLOCK, limit))):
        parts.append(part)
        limit -= len(part)
    return b"".join(parts)


def decompress_file(source: Path, destination: Path) -> str:
    """Decompress a .zstd file as far as it goes. Returns what went wrong in words, or an empty string.

    Raises InputError where the disk would fill up.
    """
    room = shutil.disk_usage(destination.parent).free - 2**28
    with open(source, "rb") as packed, open(destination, "wb") as unpacked:
        reader = zstandard.ZstdDecompressor().stream_reader(packed, read_across_frames=True)
        while True:
            try:
                part = reader.read(BLOCK)
            except zstandard.ZstdError:
                return f"{source}: the compressed file is damaged; what precedes the damage is used"
            if not part:
                return ""
            room -= len(part)
            if room < 0:
                raise InputError(f"{source}: no room to decompress it in {destination.parent}; set TMPDIR")
            unpacked.write(part)
