"""Image messages of every encoding, in both byte orders, padded, damaged and hostile."""

import array
import struct
import zlib
from types import SimpleNamespace

import cv2
import numpy as np
import pytest
from image_messages import image_message
from rosbags.typesys import Stores, get_typestore

from fisheye_ep_calib.errors import InputError
from fisheye_ep_calib.storage.images import decode_compressed, decode_file_content, decode_image


def scene(width=64, height=48) -> np.ndarray:
    """A smooth grey image, so that chroma subsampling and demosaicing leave it as it was."""
    v, u = np.mgrid[:height, :width]
    return (40 + 1.5 * u + 1.2 * v).astype(np.uint8)


def colour_samples(grey, channels, depth):
    samples = np.repeat(grey[..., None], channels, axis=2)
    return samples.astype(np.uint16) * 257 if depth == 16 else samples


def packed_422(grey, luma_first):
    samples = np.full((*grey.shape, 2), 128, dtype=np.uint8)
    samples[..., 0 if luma_first else 1] = grey
    return samples


COLOURS = {"mono": 1, "rgb": 3, "bgr": 3, "rgba": 4, "bgra": 4}
PATTERNS = ("rggb", "bggr", "gbrg", "grbg")


@pytest.mark.parametrize("padding", [0, 6])
@pytest.mark.parametrize("big_endian", [False, True])
@pytest.mark.parametrize("depth", [8, 16])
@pytest.mark.parametrize("name", [*COLOURS, *(f"bayer_{pattern}" for pattern in PATTERNS)])
def test_every_encoding_gives_the_grey_it_was_made_from(name, depth, big_endian, padding):
    grey = scene()
    samples = colour_samples(grey, COLOURS.get(name, 1), depth)
    decoded = decode_image(image_message(samples, f"{name}{depth}", 64, 48, big_endian, padding))
    assert decoded.dtype == np.uint8 and decoded.shape == grey.shape
    inner = (slice(2, -2), slice(2, -2)) if "bayer" in name else ...  # demosaicing copies the border
    if depth == 16:
        decoded = as_spread(decoded, grey, inner)
    assert np.abs(decoded[inner].astype(float) - grey[inner]).max() <= 2


def as_spread(decoded, grey, inner=...):
    """Deep images are spread over all levels: back along a line, whose ends may be cut off."""
    within = (decoded[inner] > 0) & (decoded[inner] < 255)
    slope, offset = np.polyfit(decoded[inner][within], grey[inner][within], 1)
    assert 0.4 < slope <= 1.05 and within.mean() > 0.95
    return np.where((decoded > 0) & (decoded < 255), slope * decoded + offset, grey)


@pytest.mark.parametrize(
    "encoding, samples",
    [
        ("8UC1", colour_samples(scene(), 1, 8)),
        ("8UC3", colour_samples(scene(), 3, 8)),
        ("8UC4", colour_samples(scene(), 4, 8)),
        ("16UC1", colour_samples(scene(), 1, 16)),
        ("16UC3", colour_samples(scene(), 3, 16)),
        ("yuv422", packed_422(scene(), luma_first=False)),
        ("uyvy", packed_422(scene(), luma_first=False)),
        ("yuv422_yuy2", packed_422(scene(), luma_first=True)),
        ("yuyv", packed_422(scene(), luma_first=True)),
        ("nv12", np.vstack([scene(), np.full((24, 64), 128, np.uint8)])),
        ("I420", np.vstack([scene(), np.full((24, 64), 128, np.uint8)])),
        ("yv12", np.vstack([scene(), np.full((24, 64), 128, np.uint8)])),
        ("nv21", np.vstack([scene(), np.full((24, 64), 128, np.uint8)])),
        ("nv24", np.vstack([scene(), np.full((96, 64), 128, np.uint8)])),
    ],
)
def test_other_names_and_layouts(encoding, samples):
    decoded = decode_image(image_message(samples, encoding, 64, 48))
    decoded = as_spread(decoded, scene()) if "16" in encoding else decoded
    np.testing.assert_allclose(decoded, scene(), atol=1)


@pytest.mark.parametrize("pattern", PATTERNS)
def test_bayer_patterns_weigh_each_colour_as_colour_images_do(pattern):
    rgb = {"r": 200, "g": 120, "b": 40}
    samples = np.tile(np.array([[rgb[pattern[0]], rgb[pattern[1]]], [rgb[pattern[2]], rgb[pattern[3]]]]), (8, 8))
    decoded = decode_image(image_message(samples.astype(np.uint8), f"bayer_{pattern}8", 16, 16))
    expected = 0.299 * rgb["r"] + 0.587 * rgb["g"] + 0.114 * rgb["b"]
    np.testing.assert_allclose(decoded[2:-2, 2:-2], expected, atol=2)


@pytest.mark.parametrize("scale, offset", [(16, 0), (257, 0), (4, 7000), (1, 0)])
def test_deep_images_use_the_whole_range_and_stay_linear(scale, offset):
    samples = scene(640, 480).astype(np.uint32) % 256
    decoded = decode_image(image_message((scale * samples + offset).astype(np.uint16), "mono16", 640, 480))
    assert decoded.min() <= 20 and decoded.max() >= 235
    line = np.polyfit(samples.ravel(), decoded.ravel(), 1)
    assert np.abs(np.polyval(line, samples) - decoded).max() < 1.0


def test_real_numbers_are_read_and_nan_is_black():
    samples = scene().astype(np.float32) / 1000
    samples[10:14, 20:24] = np.nan
    samples[30, 30] = np.inf
    for order in "<>":
        rows = samples.astype(f"{order}f4").view(np.uint8)
        decoded = decode_image(image_message(rows, "32FC1", 64, 48, big_endian=order == ">"))
        assert decoded[10:14, 20:24].max() < 15 and decoded[30, 30] > 240
        good = np.isfinite(samples)
        assert np.corrcoef(samples[good], decoded[good])[0, 1] > 0.9999
    nothing = np.full((48, 64), np.nan, np.float32).view(np.uint8)
    assert np.ptp(decode_image(image_message(nothing, "32FC1", 64, 48))) == 0


@pytest.mark.parametrize(
    "data_type",
    [bytes, bytearray, memoryview, list, lambda b: array.array("B", b), lambda b: np.frombuffer(b, np.uint8)],
)
def test_data_of_any_library_is_read(data_type):
    decoded = decode_image(image_message(scene(), "mono8", 64, 48, padding=3, data_type=data_type))
    np.testing.assert_array_equal(decoded, scene())


def test_grey_images_are_not_copied():
    message = image_message(scene(), "mono8", 64, 48, data_type=lambda b: np.frombuffer(b, np.uint8))
    assert np.shares_memory(decode_image(message), message.data)


def test_rosbags_messages_are_read():
    store = get_typestore(Stores.ROS2_JAZZY)
    types = store.types
    header = types["std_msgs/msg/Header"](types["builtin_interfaces/msg/Time"](1, 2), "camera")
    Image = types["sensor_msgs/msg/Image"]
    message = Image(header, 48, 64, "mono8", 0, 64, scene().reshape(-1))
    message = store.deserialize_cdr(store.serialize_cdr(message, Image.__msgtype__), Image.__msgtype__)
    np.testing.assert_array_equal(decode_image(message), scene())


@pytest.mark.parametrize(
    "changes, said",
    [
        ({"encoding": "mono7"}, "'mono7'"),
        ({"encoding": "32FC2"}, "'32FC2'"),
        ({"encoding": "32FC1"}, "a row of 64 pixels takes 256"),
        ({"encoding": ""}, "''"),
        ({"encoding": "a\nb" * 100}, "a?ba?b"),
        ({"width": 0}, "empty"),
        ({"height": 0}, "empty"),
        ({"width": 0, "height": 0, "step": 0, "data": b""}, "empty"),
        ({"width": 2**31, "height": 2**31, "step": 2**31}, "at most"),
        ({"height": 47}, "47 rows × 64"),
        ({"step": 65}, "48 rows × 65"),
        ({"step": 63}, "a row of 64 pixels takes 64"),
        ({"data": b""}, "there are 0"),
        ({"data": None}, "not a sequence"),
        ({"data": ["a"]}, "not a sequence"),
        ({"encoding": "yuv422", "width": 31, "step": 64}, "odd width"),
        ({"encoding": "rgb8"}, "takes 192"),
    ],
)
def test_a_header_that_lies_gets_one_line(changes, said):
    message = image_message(scene(), "mono8", 64, 48)
    for name, value in changes.items():
        setattr(message, name, value)
    with pytest.raises(InputError) as error:
        decode_image(message)
    assert said in str(error.value) and "\n" not in str(error.value)


@pytest.mark.parametrize("encoding", ["bayer_rggb8", "bayer_grbg8", "yuyv", "rgb8", "mono8"])
@pytest.mark.parametrize("size", [(2, 1), (2, 2), (1, 3)])
def test_tiny_images_never_crash(encoding, size):
    width, height = size
    samples = np.full((height, width, {"yuyv": 2, "rgb8": 3}.get(encoding, 1)), 9, np.uint8)
    try:
        assert decode_image(image_message(samples, encoding, width, height)).shape == (height, width)
    except InputError:
        pass


def encoded(suffix, image=None) -> bytes:
    return cv2.imencode(suffix, scene() if image is None else image)[1].tobytes()


@pytest.mark.parametrize("suffix, tolerance", [(".png", 0), (".jpg", 3), (".bmp", 0), (".tif", 0)])
@pytest.mark.parametrize("channels", [1, 3])
def test_compressed_images(suffix, tolerance, channels):
    image = np.repeat(scene()[..., None], channels, axis=2).squeeze()
    data = np.frombuffer(encoded(suffix, image), np.uint8)
    decoded = decode_compressed(SimpleNamespace(format="whatever", data=data))
    assert decoded.dtype == np.uint8
    np.testing.assert_allclose(decoded.astype(int), scene(), atol=max(tolerance, channels == 3))


def test_sixteen_bit_and_transparent_png():
    deep = decode_file_content(encoded(".png", scene().astype(np.uint16) * 16))
    np.testing.assert_allclose(as_spread(deep, scene()), scene(), atol=1)
    transparent = np.dstack([scene()] * 3 + [np.zeros_like(scene())])
    np.testing.assert_allclose(decode_file_content(encoded(".png", transparent)), scene(), atol=1)


def png_with_size(width, height) -> bytes:
    """A PNG whose header declares a size that its data does not have."""
    header = b"IHDR" + struct.pack(">IIBBBBB", width, height, 8, 0, 0, 0, 0)
    data = b"IDAT" + zlib.compress(bytes(1000))
    chunks = [header, data, b"IEND"]
    return b"\x89PNG\r\n\x1a\n" + b"".join(
        struct.pack(">I", len(chunk) - 4) + chunk + struct.pack(">I", zlib.crc32(chunk)) for chunk in chunks
    )


@pytest.mark.parametrize(
    "data, said",
    [
        (b"", "empty"),
        (b"not an image at all", "neither PNG"),
        (b"\x89PNG\r\n\x1a\n", "PNG has no header"),
        (b"\xff\xd8\xff", "cut short"),
        (b"\xff\xd8\xff\xe0", "cut short"),
        (b"BM", "cut short"),
        (b"II*\0", "cut short"),
        (png_with_size(30000, 30000), "30000×30000"),
        (png_with_size(0, 10), "empty"),
        (png_with_size(2**31, 2**31), "at most"),
        (encoded(".jpg")[:400], "cut short"),
        (encoded(".png")[:200], "cut short"),
        (encoded(".bmp")[:20], "cut short"),
    ],
)
def test_damaged_and_hostile_compressed_images(data, said):
    with pytest.raises(InputError, match=said):
        decode_compressed(SimpleNamespace(format="jpeg", data=data))


@pytest.mark.parametrize("suffix", [".png", ".jpg", ".bmp", ".tif"])
def test_damaged_images_decode_or_say_so(suffix):
    content = encoded(suffix)
    generator = np.random.default_rng(3)
    for _ in range(60):
        damaged = bytearray(content[: generator.integers(len(content)) if generator.random() < 0.3 else None])
        for position in generator.integers(max(1, min(len(damaged), 300)), size=3):
            if len(damaged):
                damaged[position] ^= 1 << generator.integers(8)
        try:
            assert decode_file_content(bytes(damaged)).dtype == np.uint8
        except InputError as error:
            assert "\n" not in str(error)
