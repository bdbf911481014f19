"""Plain data to messages."""

from __future__ import annotations

import array
from dataclasses import asdict

import numpy as np
from sensor_msgs.msg import CameraInfo, CompressedImage, Image
from std_msgs.msg import Header

from fisheye_ep_calib.camera.camera_info import PlainCameraInfo
from fisheye_ep_calib.storage.pictures import Picture


def camera_info_message(info: PlainCameraInfo) -> CameraInfo:
    """A sensor_msgs/CameraInfo without its header."""
    return CameraInfo(**asdict(info))


def picture_message(picture: Picture, header: Header) -> Image:
    """A sensor_msgs/Image, little-endian."""
    samples = np.ascontiguousarray(picture.samples)
    height, width = samples.shape[:2]
    message = Image(header=header, height=height, width=width, encoding=picture.encoding)
    message.step = samples.nbytes // height
    message.data = array.array("B", samples.astype(samples.dtype.newbyteorder("<"), copy=False).tobytes())
    return message


def compressed_message(content: bytes, header: Header) -> CompressedImage:
    """A sensor_msgs/CompressedImage of a JPEG."""
    return CompressedImage(header=header, format="bgr8; jpeg compressed bgr8", data=array.array("B", content))
