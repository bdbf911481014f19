"""Small recordings in every format, for the tests of reading them."""

from __future__ import annotations

from io import BytesIO
from pathlib import Path

import cv2
import numpy as np
from mcap.writer import CompressionType
from mcap.writer import Writer as McapWriter
from rosbags.rosbag1 import Writer as Writer1
from rosbags.rosbag2 import CompressionFormat, CompressionMode, StoragePlugin
from rosbags.rosbag2 import Writer as Writer2
from rosbags.typesys import Stores, get_typestore

IMAGE = "sensor_msgs/msg/Image"
COMPRESSED_IMAGE = "sensor_msgs/msg/CompressedImage"
IMU = "sensor_msgs/msg/Imu"
START_NS = 1_700_000_000_000_000_000

ROS2 = get_typestore(Stores.ROS2_JAZZY)
ROS1 = get_typestore(Stores.ROS1_NOETIC)


def images(count=12, width=80, height=60, seed=0) -> list[np.ndarray]:
    """Different images; their content names them."""
    generator = np.random.default_rng(seed)
    return [generator.integers(0, 256, (height, width), dtype=np.uint8) for _ in range(count)]


def messages(pictures, topic="/camera/image_raw", kind=IMAGE, start_ns=START_NS, period_ns=10**8) -> list[tuple]:
    """(topic, stamp, type, image) for the writers below."""
    return [(topic, start_ns + i * period_ns, kind, image) for i, image in enumerate(pictures)]


def serialize(kind, image, stamp_ns, ros1=False) -> bytes:
    store = ROS1 if ros1 else ROS2
    types = store.types
    stamp = types["builtin_interfaces/msg/Time"](stamp_ns // 10**9, stamp_ns % 10**9)
    sequence = (7,) if ros1 else ()
    header = types["std_msgs/msg/Header"](*sequence, stamp, "camera_frame")
    if kind == IMAGE:
        height, width = image.shape
        message = types[IMAGE](header, height, width, "mono8", 0, width, image.reshape(-1))
    elif kind == COMPRESSED_IMAGE:
        message = types[COMPRESSED_IMAGE](header, "png", cv2.imencode(".png", image)[1].reshape(-1))
    else:
        message = types["std_msgs/msg/String"]("nothing to see")
        kind = "std_msgs/msg/String"
    content = store.serialize_ros1(message, kind) if ros1 else store.serialize_cdr(message, kind)
    return bytes(content)


def write_rosbag2(path: Path, recorded, storage="sqlite3", compression: str | None = None) -> Path:
    """A rosbag2 folder; compression None, "file" or "message"."""
    plugin = StoragePlugin.MCAP if storage == "mcap" else StoragePlugin.SQLITE3
    writer = Writer2(path, version=9, storage_plugin=plugin)
    if compression:
        writer.set_compression(CompressionMode[compression.upper()], CompressionFormat.ZSTD)
    with writer:
        connections = {}
        for topic, stamp, kind, image in recorded:
            kind = kind if kind in (IMAGE, COMPRESSED_IMAGE) else "std_msgs/msg/String"
            if topic not in connections:
                connections[topic] = writer.add_connection(topic, kind, typestore=ROS2)
            writer.write(connections[topic], stamp, serialize(kind, image, stamp))
    return path


def mcap_bytes(recorded, profile="ros2", finish=True, **options) -> bytes:
    """An MCAP file; ``options`` go to its writer. Not finished: as a recorder that was killed leaves it."""
    file = BytesIO()
    writer = McapWriter(file, **{"compression": CompressionType.NONE, "chunk_size": 20_000, **options})
    writer.start(profile=profile, library="test")
    ros1 = profile == "ros1"
    channels = {}
    for topic, stamp, kind, image in recorded:
        if topic not in channels:
            kind_name = kind.replace("/msg/", "/") if ros1 else kind
            schema = writer.register_schema(kind_name, "ros1msg" if ros1 else "ros2msg", b"# none")
            channels[topic] = writer.register_channel(topic, "ros1" if ros1 else "cdr", schema)
        content = serialize(kind, image, stamp, ros1)
        writer.add_message(channels[topic], log_time=stamp, data=content, publish_time=stamp)
    if finish:
        writer.finish()
    return file.getvalue()


def write_mcap(path: Path, recorded, **options) -> Path:
    path.write_bytes(mcap_bytes(recorded, **options))
    return path


def write_ros1(path: Path, recorded, compression: str | None = None, chunk_bytes=20_000) -> Path:
    """A ROS 1 bag; compression None, "bz2" or "lz4"."""
    writer = Writer1(path)
    if compression:
        writer.set_compression(Writer1.CompressionFormat[compression.upper()])
    writer.chunk_threshold = chunk_bytes
    with writer:
        connections = {}
        for topic, stamp, kind, image in recorded:
            kind = kind if kind in (IMAGE, COMPRESSED_IMAGE) else "std_msgs/msg/String"
            if topic not in connections:
                connections[topic] = writer.add_connection(topic, kind, typestore=ROS1)
            writer.write(connections[topic], stamp, serialize(kind, image, stamp, ros1=True))
    return path


def write_folder(path: Path, pictures, suffix=".png", name="frame{}") -> Path:
    path.mkdir(parents=True)
    for number, image in enumerate(pictures):
        cv2.imwrite(str(path / (name.format(number) + suffix)), image)
    return path


def write_db3(path: Path, recorded) -> Path:
    """The one file of a rosbag2 folder with SQLite, moved to ``path``."""
    folder = write_rosbag2(path.with_suffix(".folder"), recorded)
    (file,) = folder.glob("*.db3")
    return file.rename(path)


# One for each of BAG_FORMATS: the tests of every format need files of it.
WRITERS = {".mcap": write_mcap, ".db3": write_db3, ".bag": write_ros1}
