"""The size an encoded image declares, read from its header alone, before anything is allocated for it."""

from __future__ import annotations

import re
import struct

from fisheye_ep_calib.errors import InputError
from fisheye_ep_calib.storage import tiff_pages

# 134 megapixels: above any camera's. More than 34 of them are decoded only where there are bytes enough to hold a
# photograph: looking for a target takes up to 35 bytes a pixel, and a few bytes can declare any size.
MAX_PIXELS = 2**27
MAX_PIXELS_OF_FEW_BYTES = 2**25
MAX_PIXELS_A_BYTE = 4
MAX_SAMPLE_BYTES = 400_000_000  # of all channels, decoded
MAX_TEXTS = 20  # of a PNG, compressed: a few thousand bytes each can unpack to megabytes
MAX_SCANS = 100  # of a JPEG, each of which touches every pixel; progressive ones have some ten

JPEG_FRAME_MARKERS = frozenset(range(0xC0, 0xD0)) - {0xC4, 0xC8, 0xCC}
PROGRESSIVE_MARKERS = frozenset({0xC2, 0xC6, 0xCA, 0xCE})  # scans of others cost bytes for what they do
JPEG_BARE_MARKERS = frozenset(range(0xD0, 0xD8)) | {0x01}
PNM_HEADER = re.compile(rb"P[1-6](?:\s|#[^\n]*\n)+(\d{1,9})(?:\s|#[^\n]*\n)+(\d{1,9})\s")
PNM_HEADER_BYTES = 4096
PNM_MAGICS = (b"P1", b"P2", b"P3", b"P4", b"P5", b"P6")
PNG_MAGIC = b"\x89PNG\r\n\x1a\n"
PNG_CHUNK_BYTES = 12  # of its length, kind and checksum
PNG_PACKED_KINDS = frozenset({b"zTXt", b"iTXt", b"iCCP"})
PNG_CHANNELS = {0: 1, 2: 3, 3: 4, 4: 4, 6: 4}
KINDS = "PNG, JPEG, WebP, BMP, TIFF or PGM"


def check_size(width: int, height: int, content_bytes: int, pixel_bytes: float = 1.0) -> None:
    """Raise InputError for an image with no pixels or with more than any camera has, or than its bytes can tell of.

    content_bytes: that are there to decode. pixel_bytes: that a pixel takes once it is decoded, of all channels.
    """
    if width <= 0 or height <= 0:
        raise InputError(f"the image is empty ({width}×{height})")
    pixels = width * height
    if pixels > MAX_PIXELS:
        raise InputError(f"the image declares {width}×{height} pixels; at most {MAX_PIXELS} are decoded")
    if pixels > MAX_PIXELS_OF_FEW_BYTES and pixels > MAX_PIXELS_A_BYTE * content_bytes:
        raise InputError(f"the image declares {width}×{height} pixels, but holds {content_bytes} bytes only")
    if pixels * pixel_bytes > MAX_SAMPLE_BYTES:
        raise InputError(f"the image declares {width}×{height} pixels of {pixel_bytes:g} bytes, too many")


def declared_size(content: bytes | memoryview) -> tuple[int, int]:
    """(width, height) that the header of an image of one of these KINDS declares. Raises InputError."""
    try:
        declared = _size(content)
    except (struct.error, IndexError):
        raise InputError("the image's header is cut short") from None
    if declared is None:
        raise InputError(_not_an_image(content))
    width, height, pixel_bytes = declared
    check_size(width, height, len(content), pixel_bytes)
    return width, height


def _not_an_image(content: bytes | memoryview) -> str:
    if len(content) == 0:
        return "the compressed image is empty"
    return f"the data is neither {KINDS}".replace(" or ", " nor ")


def _size(content: bytes | memoryview) -> tuple[int, int, float] | None:
    """Width, height and bytes a decoded pixel; None where it is an image of no kind that is known."""
    start = bytes(content[:16])  # slices of a view are slow to compare
    if start[:8] == PNG_MAGIC:
        return _png_size(content)
    if start[:3] == b"\xff\xd8\xff":
        return _jpeg_size(content)
    if start[:2] == b"BM":
        return (*_bmp_size(content), 4)
    if start[:4] in tiff_pages.MAGICS:
        first = tiff_pages.pages(content, most=1)
        if not first:
            raise InputError("the TIFF has no page")
        return first[0].width, first[0].height, first[0].pixel_bytes
    if start[:4] == b"RIFF" and start[8:12] == b"WEBP":
        return (*_webp_size(content), 4)
    if start[:2] in PNM_MAGICS:
        match = PNM_HEADER.match(bytes(content[:PNM_HEADER_BYTES]))
        return (int(match[1]), int(match[2]), 6) if match else None
    return None


def _png_size(content: bytes | memoryview) -> tuple[int, int, float]:
    """Of the header, the first chunk: length, IHDR, width, height, bits, colours. Then walk all chunks: a decoder
    allocates what a chunk declares, and unpacks every text."""
    if content[12:16] != b"IHDR":
        raise InputError("the PNG has no header")
    width, height, depth, colours = struct.unpack_from(">IIBB", content, 16)
    position, kind, texts = len(PNG_MAGIC), b"", 0
    while kind != b"IEND":
        if position + PNG_CHUNK_BYTES > len(content):
            raise InputError("the PNG is cut short")
        length, kind = struct.unpack_from(">I4s", content, position)
        position += PNG_CHUNK_BYTES + length
        texts += kind in PNG_PACKED_KINDS
    if position > len(content):
        raise InputError("the PNG is cut short")
    if texts > MAX_TEXTS:
        raise InputError(f"the PNG has more than {MAX_TEXTS} compressed texts")
    return width, height, PNG_CHANNELS.get(colours, 4) * max(depth, 8) / 8


def _jpeg_size(content: bytes | memoryview) -> tuple[int, int, float]:
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
            depth, height, width, channels = struct.unpack_from(">BHHB", content, position + 4)
            rest = bytes(content[position:])
            if rest.rfind(b"\xff\xd9") < 0:
                raise InputError("the JPEG is cut short")  # a decoder would fill the rest with grey
            if marker in PROGRESSIVE_MARKERS and rest.count(b"\xff\xda") > MAX_SCANS:
                raise InputError(f"the JPEG has more than {MAX_SCANS} scans")
            return width, height, channels * max(depth, 8) / 8
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
