"""Pictures to image messages."""

from __future__ import annotations

import array

import numpy as np
from sensor_msgs.msg import Image
from std_msgs.msg import Header

from fisheye_ep_calib.storage.pictures import Picture


def picture_message(picture: Picture, header: Header) -> Image:
    """A sensor_msgs/Image, little-endian."""
    samples = np.ascontiguousarray(picture.samples)
    height, width = samples.shape[:2]
    message = Image(header=header, height=height, width=width, encoding=picture.encoding)
    message.step = samples.nbytes // height
    message.data = array.array("B", samples.astype(samples.dtype.newbyteorder("<"), copy=False).tobytes())
    return message
