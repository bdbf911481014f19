"""Decompression that never yields more than it is allowed to."""

from __future__ import annotations

import bz2
import shutil
from pathlib import Path

from fisheye_ep_calib.errors import InputError
from fisheye_ep_calib.outside import open_outside
from fisheye_ep_calib.plain_text import shown

ZSTD_MAGIC = b"\x28\xb5\x2f\xfd"
BLOCK = 2**22


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

    reader = zstandard.ZstdDecompressor().stream_reader(content, read_across_frames=True)
    parts = []
    while limit > 0 and (part := reader.read(min(BLOCK, limit))):
        parts.append(part)
        limit -= len(part)
    return b"".join(parts)


def _lz4(content: bytes, limit: int) -> bytes:
    import lz4.frame

    result: bytes = lz4.frame.LZ4FrameDecompressor().decompress(content, max_length=limit)
    return result


def _bz2(content: bytes, limit: int) -> bytes:
    return bz2.BZ2Decompressor().decompress(content, max_length=limit)


DECOMPRESSORS = {"zstd": _zstd, "lz4": _lz4, "bz2": _bz2}


def decompress_file(source: Path, destination: Path) -> str:
    """Decompress a .zstd file as far as it goes. Returns what went wrong in words, or an empty string.

    Raises InputError where the disk would fill up.
    """
    try:
        import zstandard
    except ModuleNotFoundError:
        raise InputError(f"{source}: reading it needs the Python package zstandard") from None
    # Recordings do not compress a thousandfold; what does would fill the disk on purpose.
    room = min(shutil.disk_usage(destination.parent).free - 2**28, 2**30 + 1000 * source.stat().st_size)
    with open_outside(source) as packed, open(destination, "wb") as unpacked:
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
                raise InputError(
                    f"{source}: no room to decompress it in {destination.parent}; set TMPDIR to a larger disk"
                )
            unpacked.write(part)
