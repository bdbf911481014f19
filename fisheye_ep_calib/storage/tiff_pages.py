"""Where the pages of a TIFF are and how large they are, read from its directories alone.

TIFF 6.0: a header of byte order, the number 42 and the offset of the first directory; a directory of entries (tag,
kind, count, value) that ends with the offset of the next one. BigTIFF has the number 43, and wider fields.
"""

from __future__ import annotations

import struct
from mmap import mmap
from typing import NamedTuple

from fisheye_ep_calib.errors import InputError

MAGICS = (b"II*\0", b"MM\0*", b"II+\0", b"MM\0+")
MOST_PAGES = 10_000
_MOST_ENTRIES = 4096
_KIND_OF_PAGE, _WIDTH, _HEIGHT, _BITS, _CHANNELS, _TILE_WIDTH, _TILE_HEIGHT = 254, 256, 257, 258, 277, 322, 323
_TAGS = (_KIND_OF_PAGE, _WIDTH, _HEIGHT, _BITS, _CHANNELS, _TILE_WIDTH, _TILE_HEIGHT)
_USUAL_BITS = 16  # of samples that are described elsewhere in the file
_REDUCED_OR_MASK = 0b101
_FIELDS = {1: "B", 3: "H", 4: "I", 16: "Q"}


class Page(NamedTuple):
    """number: which directory of the file, counted from 0. pixel_bytes: of a decoded pixel, of all its channels; more
    where its tiles would take more than the page."""

    number: int
    width: int
    height: int
    pixel_bytes: float = 1.0


class _Layout(NamedTuple):
    order: str
    offset: str
    entries: str
    entry_bytes: int
    value_at: int


def pages(content: bytes | memoryview | mmap, most: int = MOST_PAGES) -> list[Page]:
    """The pages of a TIFF, without thumbnails and masks, up to ``most`` directories. content: bytes or a map of them.

    Raises InputError where the first page declares no size, or struct.error where the header is cut short. Damage
    after that ends the list.
    """
    order = "<" if content[:2] == b"II" else ">"
    if content[2:4] in (b"+\0", b"\0+"):
        layout, position = _Layout(order, "Q", "Q", 20, 12), 8
    else:
        layout, position = _Layout(order, "I", "H", 12, 8), 4
    listed: list[Page] = []
    (directory,) = struct.unpack_from(order + layout.offset, content, position)
    visited: set[int] = set()
    while directory and directory not in visited and len(visited) < most:
        visited.add(directory)
        try:
            tags, directory = _directory(content, directory, layout)
        except struct.error:
            if not listed:
                raise
            break
        if _WIDTH not in tags or _HEIGHT not in tags:
            if not listed:
                raise InputError("the TIFF declares no size")
            break
        if not tags.get(_KIND_OF_PAGE, 0) & _REDUCED_OR_MASK or len(visited) == 1:
            listed.append(_page(len(visited) - 1, tags))
    return listed


def _page(number: int, tags: dict[int, int]) -> Page:
    width, height = tags[_WIDTH], tags[_HEIGHT]
    pixel_bytes = tags.get(_CHANNELS, 1) * max(tags.get(_BITS, 8), 8) / 8
    tile = tags.get(_TILE_WIDTH, 0) * tags.get(_TILE_HEIGHT, 0)
    return Page(number, width, height, pixel_bytes * max(1.0, tile / max(width * height, 1)))


def _directory(content: bytes | memoryview | mmap, position: int, layout: _Layout) -> tuple[dict[int, int], int]:
    """The tags that matter here, and where the next directory is. Raises struct.error where it is not in the file."""
    if position >= len(content):
        raise struct.error("a directory beyond the end of the file")
    (entries,) = struct.unpack_from(layout.order + layout.entries, content, position)
    if entries > _MOST_ENTRIES:
        raise struct.error("more entries than a directory has")
    position += struct.calcsize(layout.entries)
    fields = {}
    for _ in range(entries):
        tag, kind, count = struct.unpack_from(f"{layout.order}HH{layout.offset}", content, position)
        if tag in _TAGS and kind in _FIELDS:
            if tag == _BITS and count > 1:
                fields[tag] = _USUAL_BITS
                continue
            (fields[tag],) = struct.unpack_from(layout.order + _FIELDS[kind], content, position + layout.value_at)
        position += layout.entry_bytes
    try:
        (following,) = struct.unpack_from(layout.order + layout.offset, content, position)
    except struct.error:
        following = 0
    return fields, following
