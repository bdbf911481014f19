"""Images to an MCAP that ROS 2 plays and this package reads; no ROS installation is needed."""

from __future__ import annotations

import os
from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path
from typing import IO, TYPE_CHECKING, Any

import cv2
import numpy as np

from fisheye_ep_calib.errors import InputError
from fisheye_ep_calib.storage.atomic import whole_file

if TYPE_CHECKING:
    from rosbags.typesys.store import Typestore

# Reliable, volatile, keep the last ten: what image publishers of a calibration should offer.
_QOS_PROFILE = """- history: keep_last
  depth: 10
  reliability: reliable
  durability: volatile
  deadline: {sec: 9223372036, nsec: 854775807}
  lifespan: {sec: 9223372036, nsec: 854775807}
  liveliness: automatic
  liveliness_lease_duration: {sec: 9223372036, nsec: 854775807}
  avoid_ros_namespace_conventions: false
"""


@dataclass(frozen=True)
class StampedImage:
    """A grey image (h, w) uint8 on its way to a bag.

    stamp_ns: header stamp and log time. compression: "png" or "jpeg" for a CompressedImage, "" for an Image.
    """

    topic: str
    stamp_ns: int
    frame_id: str
    image: np.ndarray
    compression: str = ""


def write_bag(path: str | os.PathLike[str], images: Iterable[StampedImage]) -> int:
    """Write images, in the order given, to an ``.mcap`` file; returns their number.

    The file appears under its name only when it is complete. Memory holds one image at a time.
    """
    path = Path(path)
    if path.suffix != ".mcap":
        raise InputError(f"{path}: a bag is written as one file; give it a name that ends in .mcap")
    try:
        with whole_file(path) as file:
            return _write(file, images)
    except ModuleNotFoundError as error:
        raise InputError(f"writing bags needs the Python package {error.name}: pip install {error.name}") from None


def _write(file: IO[bytes], images: Iterable[StampedImage]) -> int:
    from mcap.writer import CompressionType, Writer
    from rosbags.typesys import Stores, get_typestore

    store = get_typestore(Stores.ROS2_JAZZY)
    writer = Writer(file, chunk_size=8 << 20, compression=CompressionType.NONE)
    writer.start(profile="ros2", library="fisheye_ep_calib")
    schemas: dict[str, int] = {}
    channels: dict[tuple[str, str], int] = {}
    count = 0
    for count, item in enumerate(images, start=1):
        type_name = f"sensor_msgs/msg/{'CompressedImage' if item.compression else 'Image'}"
        if type_name not in schemas:
            definition, _ = store.generate_msgdef(type_name, ros_version=2)
            schemas[type_name] = writer.register_schema(type_name, "ros2msg", definition.encode())
        key = (item.topic, type_name)
        if key not in channels:
            channels[key] = writer.register_channel(
                item.topic, "cdr", schemas[type_name], {"offered_qos_profiles": _QOS_PROFILE}
            )
        content = bytes(store.serialize_cdr(_message(store, item), type_name))
        writer.add_message(channels[key], item.stamp_ns, content, item.stamp_ns, sequence=count)
    writer.finish()  # type: ignore[no-untyped-call]  # of the mcap package
    return count


def _message(store: Typestore, item: StampedImage) -> Any:
    """The sensor_msgs message of an image."""
    types = store.types
    stamp = types["builtin_interfaces/msg/Time"](*divmod(item.stamp_ns, 1_000_000_000))
    header = types["std_msgs/msg/Header"](stamp, item.frame_id)
    if not item.compression:
        height, width = item.image.shape
        data = np.ascontiguousarray(item.image).reshape(-1)
        return types["sensor_msgs/msg/Image"](header, height, width, "mono8", 0, width, data)
    encoded = cv2.imencode(f".{item.compression}", item.image)[1].reshape(-1)
    description = f"mono8; {item.compression} compressed mono8"
    return types["sensor_msgs/msg/CompressedImage"](header, description, encoded)
