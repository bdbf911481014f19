"""What an image may ask for before a pixel of it is decoded."""

from __future__ import annotations

import struct
import sys
import zlib
from types import SimpleNamespace

import cv2
import numpy as np
import pytest

from fisheye_ep_calib.errors import InputError
from fisheye_ep_calib.storage.image_header import MAX_SCANS, MAX_TEXTS, declared_size
from fisheye_ep_calib.storage.images import decode_file_content, decode_image


def png(width: int, height: int, depth: int = 8, colours: int = 0) -> bytes:
    """All black, in as few bytes as there can be."""
    packer = zlib.compressobj(9)
    row = bytes(1 + width * {0: 1, 2: 3, 6: 4}[colours] * depth // 8)
    data = b"".join(packer.compress(row) for _ in range(min(height, 64))) + packer.flush()

    head = struct.pack(">IIBBBBB", width, height, depth, colours, 0, 0, 0)
    return b"\x89PNG\r\n\x1a\n" + chunk(b"IHDR", head) + chunk(b"IDAT", data) + chunk(b"IEND", b"")


def chunk(kind: bytes, content: bytes) -> bytes:
    return struct.pack(">I", len(content)) + kind + content + struct.pack(">I", zlib.crc32(kind + content))


@pytest.mark.parametrize(
    ("content", "words"),
    [
        (png(8192, 8192), "holds .* bytes only"),
        (png(30_000, 30_000), "at most"),
        (png(8192, 8192, 16, 6) + bytes(2**24), "of 8 bytes, too many"),
        (b"P6 8192 8192 65535\n" + bytes(2**16), "bytes only"),
    ],
)
def test_more_pixels_than_the_bytes_can_tell_of(content, words) -> None:
    with pytest.raises(InputError, match=words):
        declared_size(content)


def test_a_photograph_of_60_megapixels_is_one() -> None:
    assert declared_size(png(9504, 6336) + bytes(16 * 2**20)) == (9504, 6336)


@pytest.mark.parametrize("kind", [b"IDAT", b"tEXt", b"IEND", b"fdAT"])
@pytest.mark.parametrize("length", [2**16, 2**31 - 1, 2**31, 2**32 - 1])
def test_a_chunk_of_a_png_that_is_longer_than_the_file(kind, length) -> None:
    """A decoder would allocate what it declares."""
    whole = png(64, 64)
    at = whole.index(b"IDAT") - 4
    content = whole[:at] + struct.pack(">I", length) + kind + whole[at + 8 :]
    with pytest.raises(InputError, match="the PNG is cut short"):
        declared_size(content)
    for keep in range(33, len(whole)):
        with pytest.raises(InputError, match="the PNG is cut short"):
            declared_size(whole[:keep])
    assert declared_size(whole) == declared_size(whole + b"more") == (64, 64)


def test_the_texts_of_a_png_are_counted() -> None:
    text = chunk(b"zTXt", b"comment\0\0" + zlib.compress(bytes(10**6), 9))
    whole = png(64, 64)
    at = whole.index(b"IDAT") - 4
    assert decode_file_content(whole[:at] + MAX_TEXTS * text + whole[at:]).shape == (64, 64)
    with pytest.raises(InputError, match="texts"):
        declared_size(whole[:at] + (MAX_TEXTS + 1) * text + whole[at:])


def test_the_scans_of_a_jpeg_are_counted() -> None:
    picture = np.random.default_rng(0).integers(0, 255, (64, 64), dtype=np.uint8)
    content = cv2.imencode(".jpg", picture, [cv2.IMWRITE_JPEG_PROGRESSIVE, 1])[1].tobytes()
    assert decode_file_content(content).shape == (64, 64)
    start = content.rindex(b"\xff\xda")
    scan = content[start:-2]
    with pytest.raises(InputError, match="scans"):
        decode_file_content(content[:start] + scan * (MAX_SCANS + 1) + content[-2:])


@pytest.mark.parametrize("tags", [{322: 2**20, 323: 2**20}, {277: 65535}, {258: 65535}])
def test_a_tiff_that_declares_a_tile_or_samples_beyond_reason(tags) -> None:
    entries = {256: 640, 257: 480, **tags}
    body = struct.pack("<H", len(entries))
    for tag, value in sorted(entries.items()):
        body += struct.pack("<HHII", tag, 4, 1, value)
    with pytest.raises(InputError, match="too many"):
        declared_size(b"II*\0" + struct.pack("<I", 8) + body + bytes(4))


@pytest.mark.parametrize("suffix", [".png", ".jpg", ".bmp", ".pgm", ".tif", ".webp"])
def test_decoders_say_nothing_of_damaged_images(suffix, capfd) -> None:
    content = cv2.imencode(suffix, np.random.default_rng(0).integers(0, 255, (40, 40), dtype=np.uint8))[1].tobytes()
    for keep in (0.5, 0.8, 0.95):
        damaged = content[: int(keep * len(content))] + (b"\xff\xd9" if suffix == ".jpg" else b"")
        try:
            decode_file_content(damaged)
        except InputError:
            pass
    assert capfd.readouterr().err == ""
    print("heard", file=sys.stderr)
    assert capfd.readouterr().err == "heard\n"


def test_a_message_of_more_pixels_than_it_has_bytes() -> None:
    message = SimpleNamespace(
        width=8192, height=8192, step=8192, encoding="mono8", is_bigendian=0, data=np.zeros(100, np.uint8)
    )
    with pytest.raises(InputError, match="bytes only"):
        decode_image(message)
