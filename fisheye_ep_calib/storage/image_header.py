"""The size an encoded image declares, read from its header alone, before anything is allocated for it."""

from __future__ import annotations

import struct

from fisheye_ep_calib.errors import InputError

# 134 megapixels: above any camera's, below what would exhaust a machine.
MAX_PIXELS = 2**27

JPEG_FRAME_MARKERS = frozenset(range(0xC0, 0xD0)) - {0xC4, 0xC8, 0xCC}
JPEG_BARE_MARKERS = frozenset(range(0xD0, 0xD8)) | {0x01}
TIFF_WIDTH, TIFF_HEIGHT = 256, 257


def check_size(width: int, height: int) -> None:
    """Raise InputError for an image with no pixels or with more than any camera has."""
    if width <= 0 or height <= 0:
        raise InputError(f"the image is empty ({width}×{height})")
    if width * height > MAX_PIXELS:
        raise InputError(f"the image declares {width}×{height} pixels; at most {MAX_PIXELS} are decoded")


def declared_size(content: bytes | memoryview) -> tuple[int, int]:
    """(width, height) that the header of a PNG, JPEG, BMP or TIFF declares. Raises InputError."""
    try:
        size = _size(content)
    except (struct.error, IndexError):
        raise InputError("the image's header is cut short") from None
    if size is None:
        raise InputError(_not_an_image(content))
    check_size(*size)
    return size


def _not_an_image(content: bytes | memoryview) -> str:
    if len(content) == 0:
        return "the compressed image is empty"
    return "the data is neither PNG, JPEG, BMP nor TIFF"


def _size(content: bytes | memoryview) -> tuple[int, int] | None:
    if content[:8] == b"\x89PNG\r\n\x1a\n":
        if content[12:16] != b"IHDR":
            raise InputError("the PNG has no header")
        return struct.unpack_from(">II", content, 16)
    if content[:3] == b"\xff\xd8\xff":
        return _jpeg_size(content)
    if content[:2] == b"BM":
        return _bmp_size(content)
    if content[:4] in (b"II*\0", b"MM\0*"):
        return _tiff_size(content)
    return None


def _jpeg_size(content: bytes | memoryview) -> tuple[int, int]:
    """Walk the segments to the frame header (SOFn): marker, length, precision, height, width."""
    position = 2
    while True:
        while content[position] == 0xFF and content[position + 1] == 0xFF:  # fill bytes
            position += 1
        marker_start, marker = content[position], content[position + 1]
        if marker_start != 0xFF:
            raise InputError("the JPEG's segments are damaged")
        if marker in JPEG_BARE_MARKERS:
            position += 2
            continue
        if marker in JPEG_FRAME_MARKERS:
            height, width = struct.unpack_from(">HH", content, position + 5)
            if bytes(content[position:]).rfind(b"\xff\xd9") < 0:
                raise InputError("the JPEG is cut short")  # a decoder would fill the rest with grey
            return width, height
        (length,) = struct.unpack_from(">H", content, position + 2)
        if length < 2 or marker in (0xD9, 0xDA):
            raise InputError("the JPEG has no frame header")
        position += 2 + length


def _bmp_size(content: bytes | memoryview) -> tuple[int, int]:
    (header_length,) = struct.unpack_from("<I", content, 14)
    if header_length == 12:
        return struct.unpack_from("<HH", content, 18)
    width, height = struct.unpack_from("<ii", content, 18)
    return width, abs(height)  # a negative height says the rows run downwards


def _tiff_size(content: bytes | memoryview) -> tuple[int, int]:
    """Width and height among the tags of the first directory."""
    order = "<" if content[:2] == b"II" else ">"
    (directory,) = struct.unpack_from(f"{order}I", content, 4)
    (entries,) = struct.unpack_from(f"{order}H", content, directory)
    found = {}
    for index in range(entries):
        offset = directory + 2 + 12 * index
        tag, kind = struct.unpack_from(f"{order}HH", content, offset)
        if tag in (TIFF_WIDTH, TIFF_HEIGHT):
            (found[tag],) = struct.unpack_from(f"{order}{'H' if kind == 3 else 'I'}", content, offset + 8)
    if len(found) < 2:
        raise InputError("the TIFF declares no size")
    return found[TIFF_WIDTH], found[TIFF_HEIGHT]
