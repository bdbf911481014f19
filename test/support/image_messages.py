"""Image messages as ROS has them."""

from __future__ import annotations

from types import SimpleNamespace

import numpy as np


def image_message(
    samples, encoding: str, width: int, height: int, big_endian: bool = False, padding: int = 0, data_type=bytes
) -> SimpleNamespace:
    """A message with the attributes of sensor_msgs/Image. samples (h, w, ...): of this machine's byte order."""
    samples = np.asarray(samples)
    rows = np.ascontiguousarray(samples.byteswap() if big_endian else samples).reshape(samples.shape[0], -1)
    rows = np.pad(rows.view(np.uint8), ((0, 0), (0, padding)), constant_values=255)
    return SimpleNamespace(
        height=height,
        width=width,
        encoding=encoding,
        is_bigendian=int(big_endian),
        step=rows.shape[1],
        data=data_type(rows.tobytes()),
    )
