"""Image messages, compressed image messages and image files → grey images (h, w) uint8.

A message is anything with the attributes of sensor_msgs/Image or sensor_msgs/CompressedImage: those of rclpy
and of rosbags alike. What a header declares is checked before anything is allocated or decoded.
"""

from __future__ import annotations

import os
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import cv2
import numpy as np

from fisheye_ep_calib.errors import InputError
from fisheye_ep_calib.storage.grey_levels import to_eight_bits
from fisheye_ep_calib.storage.image_header import check_size, declared_size
from fisheye_ep_calib.storage.messages import Message
from fisheye_ep_calib.storage.quiet_libraries import quiet_libraries


@dataclass(frozen=True)
class Layout:
    """How an encoding lays out its pixels.

    depth: bits a sample, 8, 16 or, of real numbers, 32. channels: samples a pixel in a row of ``step`` bytes.
    to_grey: OpenCV's conversion code; None where the first plane is the grey image.
    rows: rows of ``step`` bytes for one row of the image (more than 1 where colour planes follow).
    """

    depth: int
    channels: int
    to_grey: int | None = None
    rows: float = 1.0


# sensor_msgs names a Bayer pattern by its first two pixels, OpenCV by the second row's second and third.
BAYER_TO_GREY = {
    "rggb": cv2.COLOR_BayerBG2GRAY,
    "bggr": cv2.COLOR_BayerRG2GRAY,
    "gbrg": cv2.COLOR_BayerGR2GRAY,
    "grbg": cv2.COLOR_BayerGB2GRAY,
}

LAYOUTS = {
    "uyvy": Layout(8, 2, cv2.COLOR_YUV2GRAY_UYVY),
    "yuyv": Layout(8, 2, cv2.COLOR_YUV2GRAY_YUY2),
    "nv12": Layout(8, 1, rows=1.5),
    "nv21": Layout(8, 1, rows=1.5),
    "nv24": Layout(8, 1, rows=3.0),
}
for _name in ("i420", "iyuv", "yv12", "yuv420", "yuv420p"):
    LAYOUTS[_name] = Layout(8, 1, rows=1.5)
LAYOUTS["32fc1"] = LAYOUTS["32fc"] = Layout(32, 1)
LAYOUTS["yuv422"] = LAYOUTS["uyvy"]
LAYOUTS["yuv422_yuy2"] = LAYOUTS["yuyv"]
for _depth in (8, 16):
    LAYOUTS[f"mono{_depth}"] = LAYOUTS[f"{_depth}uc1"] = LAYOUTS[f"{_depth}uc"] = Layout(_depth, 1)
    LAYOUTS[f"rgb{_depth}"] = Layout(_depth, 3, cv2.COLOR_RGB2GRAY)
    LAYOUTS[f"bgr{_depth}"] = LAYOUTS[f"{_depth}uc3"] = Layout(_depth, 3, cv2.COLOR_BGR2GRAY)
    LAYOUTS[f"rgba{_depth}"] = Layout(_depth, 4, cv2.COLOR_RGBA2GRAY)
    LAYOUTS[f"bgra{_depth}"] = LAYOUTS[f"{_depth}uc4"] = Layout(_depth, 4, cv2.COLOR_BGRA2GRAY)
    for _pattern, _code in BAYER_TO_GREY.items():
        LAYOUTS[f"bayer_{_pattern}{_depth}"] = Layout(_depth, 1, _code)

_GREY_OF_CHANNELS = {1: None, 3: cv2.COLOR_BGR2GRAY, 4: cv2.COLOR_BGRA2GRAY}


def decode_image(message: Message) -> np.ndarray:
    """sensor_msgs/Image → grey (h, w) uint8; a view of the message's data where that is grey already.

    Deeper samples are brought to the range of the scene. Raises InputError.
    """
    return to_eight_bits(grey_image(message))


def grey_image(message: Message) -> np.ndarray:
    """sensor_msgs/Image → grey (h, w) of its own depth: uint8, uint16 or float32. Raises InputError."""
    samples, layout = checked_samples(message)
    return _to_grey(samples[: int(message.height)], layout.to_grey)


def checked_samples(message: Message) -> tuple[np.ndarray, Layout]:
    """The samples of a sensor_msgs/Image (rows, width[, channels]) of 8, 16 or 32 bits, and how they are laid out.

    There are more rows than the image has where colour planes follow. Raises InputError where header and data
    do not fit together.
    """
    layout = LAYOUTS.get(str(message.encoding).strip().lower())
    if layout is None:
        raise InputError(f"the image's encoding is {short_name(message.encoding)!r}, which cannot be read")
    width, height, step = int(message.width), int(message.height), int(message.step)
    data = as_bytes(message.data)
    check_size(width, height, len(data))
    if layout.channels == 2 and width % 2:
        raise InputError(f"an image of encoding {message.encoding} cannot have an odd width ({width})")
    row_bytes = width * layout.channels * layout.depth // 8
    if step < row_bytes:
        raise InputError(f"the image's step is {step} bytes, but a row of {width} pixels takes {row_bytes}")
    rows = int(height * layout.rows)
    if step > row_bytes and len(data) == (rows - 1) * step + row_bytes:  # the last row's padding was left out
        data = np.concatenate([data, np.zeros(step - row_bytes, dtype=np.uint8)])
    if len(data) != rows * step:
        raise InputError(
            f"the image's header says {rows} rows × {step} bytes = {rows * step}, but there are {len(data)}"
        )
    samples = data.reshape(rows, step)[:, :row_bytes]
    if layout.depth > 8:
        kind = "u2" if layout.depth == 16 else "f4"
        samples = np.ascontiguousarray(samples).view((">" if message.is_bigendian else "<") + kind)
        samples = samples.astype(kind, copy=False)
    if layout.channels > 1:
        samples = samples.reshape(rows, width, layout.channels)
    return samples, layout


def decode_compressed(message: Message) -> np.ndarray:
    """sensor_msgs/CompressedImage (JPEG or PNG, whatever its ``format`` says) → grey (h, w) uint8."""
    return to_eight_bits(grey_of_compressed(message))


def grey_of_compressed(message: Message) -> np.ndarray:
    """sensor_msgs/CompressedImage → grey (h, w) of its own depth: uint8, uint16 or float32. Raises InputError."""
    return grey_of_samples(decoded_file(as_bytes(message.data)))


def decode_file_content(content: bytes | np.ndarray) -> np.ndarray:
    """The content of an image file → grey (h, w) uint8. Raises InputError."""
    return to_eight_bits(grey_of_samples(decoded_file(content)))


def grey_of_samples(samples: np.ndarray) -> np.ndarray:
    """Decoded samples (h, w, 1, 3 or 4), blue green red alpha → grey (h, w) of the same depth."""
    return _to_grey(samples, _GREY_OF_CHANNELS[samples.shape[2]])


def decoded_file(content: bytes | np.ndarray) -> np.ndarray:
    """The content of an image file → (h, w, 1, 3 or 4), blue green red alpha. Raises InputError.

    Of 8 or 16 bits or, grey, of real numbers.
    """
    data = np.frombuffer(content, dtype=np.uint8)
    size = declared_size(data.data)
    try:
        # Pixels as they are stored: a rotation in the EXIF block is for viewers, not for the sensor.
        with quiet_libraries():
            image = cv2.imdecode(data, cv2.IMREAD_UNCHANGED)
    except (cv2.error, MemoryError):
        image = None
    return _as_declared(image, size)


def decoded_page(path: Path, page: int, size: tuple[int, int], pixel_bytes: float) -> np.ndarray:
    """A page of a TIFF, which declares this (width, height), as ``decoded_file`` gives it. Raises InputError."""
    check_size(*size, path.stat().st_size, pixel_bytes)
    try:
        with quiet_libraries():
            _, images = cv2.imreadmulti(os.fspath(path), page, 1, flags=cv2.IMREAD_UNCHANGED)
    except (cv2.error, MemoryError):
        images = ()
    return _as_declared(images[0] if len(images) else None, size)


def _as_declared(image: np.ndarray | None, size: tuple[int, int]) -> np.ndarray:
    width, height = size
    if image is None:
        raise InputError("the compressed image cannot be decoded")
    if image.shape[:2] != (height, width):
        raise InputError(f"the compressed image declares {width}×{height} and holds another size")
    channels = 1 if image.ndim == 2 else image.shape[2]
    if image.dtype not in (np.uint8, np.uint16) and not (image.dtype == np.float32 and channels == 1):
        raise InputError(f"the compressed image holds samples of type {image.dtype}, not 8 or 16 bits")
    if channels not in _GREY_OF_CHANNELS:
        raise InputError(f"the compressed image has {channels} channels")
    return image.reshape(height, width, channels)


def _to_grey(samples: np.ndarray, code: int | None) -> np.ndarray:
    if code is None:
        return samples.reshape(samples.shape[:2])
    try:
        return cv2.cvtColor(samples, code)
    except cv2.error:
        raise InputError(f"an image of {samples.shape[1]}×{samples.shape[0]} pixels cannot be converted") from None


def as_bytes(data: Any) -> np.ndarray:
    """Bytes, a memoryview, an array.array or an array of uint8 without a copy; a list of numbers with one."""
    try:
        if isinstance(data, list | tuple):
            data = bytes(data)
        return np.frombuffer(data, dtype=np.uint8)
    except (TypeError, ValueError, BufferError):
        raise InputError("the image's data is not a sequence of bytes") from None


def short_name(text: object) -> str:
    """A name from a message, fit to stand in one line."""
    line = "".join(character if character.isprintable() else "?" for character in str(text))
    return line if len(line) <= 40 else line[:40] + "…"
