"""Pictures keep their colours; depth images become metres."""

from __future__ import annotations

from types import SimpleNamespace

import cv2
import numpy as np
import pytest
from image_messages import image_message

from fisheye_ep_calib.errors import InputError
from fisheye_ep_calib.storage.images import LAYOUTS
from fisheye_ep_calib.storage.pictures import decode_compressed_picture, decode_depth, decode_picture
from fisheye_ep_calib.storage.recording import open_recording

BLUE_GREEN_RED = np.array([50, 100, 200])


def scene(height: int = 24, width: int = 32) -> np.ndarray:
    """One colour all over, so that no conversion blurs it: (h, w, 3) uint8."""
    return np.tile(BLUE_GREEN_RED, (height, width, 1)).astype(np.uint8)


def message(samples: np.ndarray, encoding: str, big_endian: bool = False):
    return image_message(samples, encoding, 32, 24, big_endian)


@pytest.mark.parametrize("big_endian", [False, True])
@pytest.mark.parametrize("depth", [8, 16])
@pytest.mark.parametrize("order", ["rgb", "bgr", "rgba", "bgra"])
def test_colours_stay_in_their_order(order, depth, big_endian) -> None:
    colours = np.concatenate([scene(), np.full((24, 32, 1), 255, np.uint8)], axis=-1)
    samples = np.stack([colours[..., "bgra".index(name)] for name in order], axis=-1)
    if depth == 16:
        samples = samples.astype(np.uint16) * 257
    picture = decode_picture(message(samples, f"{order}{depth}", big_endian=big_endian and depth == 16))
    assert picture.encoding == f"{order}{depth}" and (picture.samples == samples).all()
    assert (picture.for_opencv()[..., :3] // (257 if depth == 16 else 1) == BLUE_GREEN_RED).all()


@pytest.mark.parametrize("encoding", ["mono8", "8UC1", "mono16", "16UC1"])
def test_grey_stays_grey(encoding) -> None:
    samples = np.arange(24 * 32).reshape(24, 32).astype(np.uint16 if "16" in encoding else np.uint8)
    picture = decode_picture(message(samples, encoding))
    assert picture.encoding == ("mono16" if "16" in encoding else "mono8") and (picture.samples == samples).all()


@pytest.mark.parametrize("depth", [8, 16])
@pytest.mark.parametrize("pattern", ["rggb", "bggr", "gbrg", "grbg"])
def test_bayer_patterns_get_their_colours(pattern, depth) -> None:
    samples = np.zeros((24, 32), np.uint16)
    for place, letter in enumerate(pattern):
        samples[place // 2 :: 2, place % 2 :: 2] = BLUE_GREEN_RED["bgr".index(letter)]
    picture = decode_picture(message(samples.astype(f"u{depth // 8}"), f"bayer_{pattern}{depth}"))
    assert picture.encoding == f"bgr{depth}" and (picture.samples[2:-2, 2:-2] == BLUE_GREEN_RED).all()


@pytest.mark.parametrize("encoding", ["uyvy", "yuyv", "nv12", "nv21", "i420", "yv12"])
def test_yuv_gets_its_colours(encoding) -> None:
    # ITU-R BT.601, studio swing: what OpenCV takes YUV images for.
    b, g, r = BLUE_GREEN_RED
    y = 16 + 0.257 * r + 0.504 * g + 0.098 * b
    u, v = 128 - 0.148 * r - 0.291 * g + 0.439 * b, 128 + 0.439 * r - 0.368 * g - 0.071 * b
    if encoding in ("i420", "yv12"):
        chroma = np.repeat([u, v] if encoding == "i420" else [v, u], 12 * 16).reshape(12, 32)
        samples = np.concatenate([np.full((24, 32), y), chroma])
    elif encoding.startswith("nv"):
        chroma = np.tile([u, v] if encoding == "nv12" else [v, u], (12, 16))
        samples = np.concatenate([np.full((24, 32), y), chroma])
    else:
        samples = np.tile([u, y, v, y] if encoding == "uyvy" else [y, u, y, v], (24, 16))
    picture = decode_picture(message(np.rint(samples).astype(np.uint8), encoding))
    assert picture.encoding == "bgr8" and picture.samples.shape == (24, 32, 3)
    assert np.abs(picture.samples.astype(int) - BLUE_GREEN_RED).max() <= 4


@pytest.mark.parametrize("encoding", sorted(LAYOUTS))
def test_every_encoding_that_can_be_read_gives_a_picture(encoding) -> None:
    layout = LAYOUTS[encoding]
    samples = np.full(
        (int(24 * layout.rows), 32 * layout.channels), 77, "f4" if layout.depth == 32 else f"u{layout.depth // 8}"
    )
    picture = decode_picture(message(samples, encoding.upper()))
    assert picture.samples.shape[:2] == (24, 32)
    assert picture.encoding in LAYOUTS and LAYOUTS[picture.encoding].depth == 8 * picture.samples.itemsize


@pytest.mark.parametrize("extension", [".png", ".jpg"])
def test_compressed_pictures(extension) -> None:
    content = cv2.imencode(extension, scene())[1].tobytes()
    picture = decode_compressed_picture(SimpleNamespace(data=content))
    assert picture.encoding == "bgr8" and np.abs(picture.samples.astype(int) - BLUE_GREEN_RED).max() <= 3
    grey = decode_compressed_picture(SimpleNamespace(data=cv2.imencode(extension, scene()[..., 0])[1].tobytes()))
    assert grey.encoding == "mono8" and grey.samples.shape == (24, 32)


def test_frames_of_a_folder_have_pictures(tmp_path) -> None:
    cv2.imwrite(str(tmp_path / "a.png"), scene())
    with open_recording(tmp_path) as recording:
        (frame,) = recording.frames()
        assert (frame.picture().samples == scene()).all()


@pytest.mark.parametrize("big_endian", [False, True])
def test_depth_in_millimetres_and_in_metres(big_endian) -> None:
    millimetres = np.full((24, 32), 1500, np.uint16)
    millimetres[0, 0] = 0
    depth = decode_depth(message(millimetres, "16UC1", big_endian=big_endian))
    assert np.isnan(depth[0, 0]) and np.allclose(depth[1:], 1.5)
    metres = np.full((24, 32), 0.25, np.float32)
    metres[0, :4] = [np.nan, -1, 0, np.inf]
    depth = decode_depth(message(metres, "32FC1", big_endian=big_endian))
    assert np.isnan(depth[0, :3]).all() and np.isinf(depth[0, 3]) and np.allclose(depth[1:], 0.25)


@pytest.mark.parametrize(
    "changes",
    [
        {"width": 0, "height": 0},
        {"width": 2**31, "height": 2**31},
        {"step": 2**31},
        {"step": 1},
        {"data": b""},
        {"data": "text"},
        {"encoding": "64FC1"},
        {"encoding": "rgb8"},
        {"encoding": "x" * 1000},
    ],
    ids=str,
)
@pytest.mark.parametrize("decode", [decode_picture, decode_depth])
def test_headers_that_lie_are_refused_in_one_line(decode, changes) -> None:
    content = message(np.ones((24, 32), np.uint16), "16UC1")
    vars(content).update(changes)
    with pytest.raises(InputError) as raised:
        decode(content)
    assert len(str(raised.value)) < 200 and "\n" not in str(raised.value)
