"""Images with their colours, and depth images: for showing and for rectifying, where ``images`` serves detectors."""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np

from fisheye_ep_calib.errors import InputError
from fisheye_ep_calib.storage.grey_levels import to_eight_bits
from fisheye_ep_calib.storage.image_header import check_size
from fisheye_ep_calib.storage.images import as_bytes, checked_samples, decoded_file, short_name
from fisheye_ep_calib.storage.messages import Message

_BAYER_TO_BGR = {
    "rggb": cv2.COLOR_BayerBG2BGR,
    "bggr": cv2.COLOR_BayerRG2BGR,
    "gbrg": cv2.COLOR_BayerGR2BGR,
    "grbg": cv2.COLOR_BayerGB2BGR,
}
# What is kept as it is, by ROS's name for it; everything else becomes blue green red, or grey.
_KEPT = {
    **{f"{name}{depth}": f"{name}{depth}" for depth in (8, 16) for name in ("mono", "rgb", "bgr", "rgba", "bgra")},
    **{f"{depth}uc{end}": f"mono{depth}" for depth in (8, 16) for end in ("", "1")},
    **{f"{depth}uc{count}": f"{name}{depth}" for depth in (8, 16) for count, name in ((3, "bgr"), (4, "bgra"))},
}
_PACKED_TO_BGR = {
    "uyvy": cv2.COLOR_YUV2BGR_UYVY,
    "yuv422": cv2.COLOR_YUV2BGR_UYVY,
    "yuyv": cv2.COLOR_YUV2BGR_YUY2,
    "yuv422_yuy2": cv2.COLOR_YUV2BGR_YUY2,
}
_PLANES_TO_BGR = {
    "nv12": cv2.COLOR_YUV2BGR_NV12,
    "nv21": cv2.COLOR_YUV2BGR_NV21,
    "yv12": cv2.COLOR_YUV2BGR_YV12,
    **dict.fromkeys(("i420", "iyuv", "yuv420", "yuv420p"), cv2.COLOR_YUV2BGR_I420),
}
_OF_CHANNELS = {1: "mono", 3: "bgr", 4: "bgra"}
_METRES_PER_UNIT = {"32fc1": ("f4", 1.0), "16uc1": ("u2", 1e-3), "mono16": ("u2", 1e-3)}  # REP 118


@dataclass(frozen=True)
class Picture:
    """samples (h, w) or (h, w, channels) of 8 or 16 bits; encoding: what sensor_msgs calls their order."""

    samples: np.ndarray
    encoding: str

    def for_opencv(self) -> np.ndarray:
        """The samples in the order in which OpenCV writes files: blue green red alpha."""
        if self.encoding.startswith("rgba"):
            return cv2.cvtColor(self.samples, cv2.COLOR_RGBA2BGRA)
        return cv2.cvtColor(self.samples, cv2.COLOR_RGB2BGR) if self.encoding.startswith("rgb") else self.samples


def decode_picture(message: Message) -> Picture:
    """sensor_msgs/Image → a picture: Bayer patterns and YUV become blue green red. Raises InputError."""
    samples, _ = checked_samples(message)
    encoding = str(message.encoding).strip().lower()
    if encoding in _KEPT:
        return Picture(samples, _KEPT[encoding])
    height, depth = int(message.height), 8 * samples.itemsize
    try:
        if encoding in _PACKED_TO_BGR:
            return Picture(cv2.cvtColor(samples, _PACKED_TO_BGR[encoding]), "bgr8")
        if encoding.startswith("bayer_"):
            code = _BAYER_TO_BGR[encoding.removeprefix("bayer_").rstrip("0123456789")]
            return Picture(cv2.cvtColor(samples, code), f"bgr{depth}")
        if encoding in _PLANES_TO_BGR and height % 2 == 0 and samples.shape[1] % 2 == 0:
            return Picture(cv2.cvtColor(np.ascontiguousarray(samples), _PLANES_TO_BGR[encoding]), "bgr8")
    except cv2.error:
        raise InputError(f"an image of {samples.shape[1]}×{height} pixels cannot be converted") from None
    return Picture(to_eight_bits(samples[:height]), "mono8")


def decode_compressed_picture(message: Message) -> Picture:
    """sensor_msgs/CompressedImage (JPEG or PNG) → a picture. Raises InputError."""
    return decode_picture_content(as_bytes(message.data))


def decode_picture_content(content: bytes | np.ndarray) -> Picture:
    """The content of an image file → a picture. Raises InputError."""
    return picture_of(decoded_file(content))


def picture_of(samples: np.ndarray) -> Picture:
    """Decoded samples (h, w, 1, 3 or 4), blue green red alpha, as a picture."""
    if samples.dtype == np.float32:
        return Picture(to_eight_bits(samples[..., 0]), "mono8")
    encoding = f"{_OF_CHANNELS[samples.shape[2]]}{8 * samples.itemsize}"
    return Picture(samples[..., 0] if samples.shape[2] == 1 else samples, encoding)


def decode_depth(message: Message) -> np.ndarray:
    """A depth image (sensor_msgs/Image, 32FC1 in metres or 16UC1 in millimetres) → (h, w) float32, metres.

    NaN where there is no depth: 0 of 16UC1, whatever is not positive of 32FC1. Raises InputError.
    """
    encoding = str(message.encoding).strip().lower()
    if encoding not in _METRES_PER_UNIT:
        raise InputError(f"a depth image is 32FC1 or 16UC1, not {short_name(message.encoding)!r}")
    kind, metres = _METRES_PER_UNIT[encoding]
    width, height, step = int(message.width), int(message.height), int(message.step)
    data = as_bytes(message.data)
    check_size(width, height, len(data))
    row_bytes = width * np.dtype(kind).itemsize
    if step < row_bytes or len(data) != height * step:
        raise InputError(
            f"the depth image's header says {height} rows × {step} bytes, for {width} pixels each, not {len(data)}"
        )
    rows = np.ascontiguousarray(data.reshape(height, step)[:, :row_bytes])
    depth = rows.view((">" if message.is_bigendian else "<") + kind).astype(np.float32)
    if metres != 1.0:
        depth *= np.float32(metres)
    return np.where(depth > 0, depth, np.float32(np.nan))
