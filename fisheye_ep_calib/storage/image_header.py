"""The size an encoded image declares, read from its header alone, before anything is allocated for it."""

from __future__ import annotations

import re
import struct

from fisheye_ep_calib.errors import InputError
from fisheye_ep_calib.storage import tiff_pages

# 134 megapixels: above any camera's, below what would exhaust a machine.
MAX_PIXELS = 2**27

JPEG_FRAME_MARKERS = frozenset(range(0xC0, 0xD0)) - {0xC4, 0xC8, 0xCC}
JPEG_BARE_MARKERS = frozenset(range(0xD0, 0xD8)) | {0x01}
PNM_HEADER = re.compile(rb"P[1-6](?:\s|#[^\n]*\n)+(\d{1,9})(?:\s|#[^\n]*\n)+(\d{1,9})\s")
PNM_HEADER_BYTES = 4096
KINDS = "PNG, JPEG, WebP, BMP, TIFF or PGM"


def check_size(width: int, height: int) -> None:
    """Raise InputError for an image with no pixels or with more than any camera has."""
    if width <= 0 or height <= 0:
        raise InputError(f"the image is empty ({width}×{height})")
    if width * height > MAX_PIXELS:
        raise InputError(f"the image declares {width}×{height} pixels; at most {MAX_PIXELS} are decoded")


def declared_size(content: bytes | memoryview) -> tuple[int, int]:
    """(width, height) that the header of an image of one of these KINDS declares. Raises InputError."""
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
    return f"the data is neither {KINDS}".replace(" or ", " nor ")


def _size(content: bytes | memoryview) -> tuple[int, int] | None:
    if content[:8] == b"\x89PNG\r\n\x1a\n":
        if content[12:16] != b"IHDR":
            raise InputError("the PNG has no header")
        return struct.unpack_from(">II", content, 16)
    if content[:3] == b"\xff\xd8\xff":
        return _jpeg_size(content)
    if content[:2] == b"BM":
        return _bmp_size(content)
    if content[:4] in tiff_pages.MAGICS:
        first = tiff_pages.pages(content, most=1)
        if not first:
            raise InputError("the TIFF has no page")
        return first[0].width, first[0].height
    if content[:4] == b"RIFF" and content[8:12] == b"WEBP":
        return _webp_size(content)
    if content[:1] == b"P" and content[1:2] in (b"1", b"2", b"3", b"4", b"5", b"6"):
        match = PNM_HEADER.match(bytes(content[:PNM_HEADER_BYTES]))
        return (int(match[1]), int(match[2])) if match else None
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


def _webp_size(content: bytes | memoryview) -> tuple[int, int]:
    """Of the first chunk: VP8 (lossy), VP8L (lossless: 14 bits each, less one) or VP8X (24 bits each, less one)."""
    kind = bytes(content[12:16])
    if kind == b"VP8 ":
        width, height = struct.unpack_from("<HH", content, 26)
        return width & 0x3FFF, height & 0x3FFF
    if kind == b"VP8L":
        (bits,) = struct.unpack_from("<I", content, 21)
        return (bits & 0x3FFF) + 1, (bits >> 14 & 0x3FFF) + 1
    if kind == b"VP8X":
        low_width, high_width, low_height, high_height = struct.unpack_from("<HBHB", content, 24)
        return (high_width << 16 | low_width) + 1, (high_height << 16 | low_height) + 1
    raise InputError("the WebP holds no image")
