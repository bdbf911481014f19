"""What every source of images offers, whatever its format."""

from __future__ import annotations

import bisect
import hashlib
from functools import cached_property
from pathlib import Path
from typing import Any, BinaryIO, NamedTuple

import numpy as np

from fisheye_ep_calib.errors import InputError
from fisheye_ep_calib.outside import open_outside
from fisheye_ep_calib.plain_text import one_line
from fisheye_ep_calib.storage.budget import Budget, Spent
from fisheye_ep_calib.storage.compression import ZSTD_MAGIC, decompress
from fisheye_ep_calib.storage.image_header import MAX_PIXELS_OF_FEW_BYTES, check_size
from fisheye_ep_calib.storage.images import as_bytes, decoded_file, grey_image, grey_of_samples
from fisheye_ep_calib.storage.messages import Message, deserialize
from fisheye_ep_calib.storage.pictures import Picture, decode_compressed_picture, decode_picture
from fisheye_ep_calib.storage.sources.open_files import forget, note_use
from fisheye_ep_calib.storage.video import VIDEO_TYPES, Packet, VideoDecoder, colours_of, grey_of, packet_of

IMAGE = "sensor_msgs/msg/Image"
COMPRESSED_IMAGE = "sensor_msgs/msg/CompressedImage"
IMAGE_TYPES = (IMAGE, COMPRESSED_IMAGE, *VIDEO_TYPES)

MAX_MESSAGE_BYTES = 2**28  # 134 megapixels of 16 bits
_END_BYTES = 2**16
_LONGEST_NAME = 300


class Entry(NamedTuple):
    """One image: when it was recorded, and where in the file it is, in the format's own terms."""

    stamp_ns: int
    location: tuple[int, ...]


class Source:
    """One file; its images are listed once it is opened. Pickles without its open file, so that workers can
    read by themselves.

    topics: every topic in the file → its type as ROS 2 spells it. entries: image topics → their images.
    problems: what of the file is lost, in words a user understands. timed: its entries' times are of a clock.
    """

    timed = True

    def __init__(self, path: Path) -> None:
        self.path = path
        self.topics: dict[str, str] = {}
        self.entries: dict[str, list[Entry]] = {}
        self.problems: list[str] = []
        self.budget = Budget()
        self._file: Any = None
        self._fingerprint: str | None = None

    @classmethod
    def open(cls, path: Path, budget: Budget | None = None) -> Source:
        """Open a file and list its images. Raises InputError where it is not of this format.

        budget: of the recording that the file belongs to; its own where it is not given. Where it is used up, what was
        reached is listed, and ``problems`` says so.
        """
        source = cls(path)
        source.budget = budget or source.budget
        source.budget.grow(path.stat().st_size)
        try:
            source.list_images()
        except Spent as spent:
            source.problems.append(f"{path}: {spent}; the {source.image_count} images found until then are used")
        except OSError as error:
            source.close()
            raise InputError(f"{path} cannot be read: {error.strerror or error}") from None
        except BaseException:
            source.close()
            raise
        for topic, entries in source.entries.items():
            source.entries[topic] = sorted(dict.fromkeys(entries), key=lambda entry: entry.stamp_ns)
        return source

    @property
    def image_count(self) -> int:
        """Images of all topics."""
        return sum(len(entries) for entries in self.entries.values())

    def list_images(self) -> None:
        """Fill in topics, entries and problems; ``budget`` is told what it costs."""
        raise NotImplementedError

    def grey(self, topic: str, entry: Entry) -> np.ndarray:
        """The image as grey (h, w) of its own depth, uint8, uint16 or float32. Raises InputError where damaged."""
        raise NotImplementedError

    def picture(self, topic: str, entry: Entry) -> Picture:
        """The image with its colours. Raises InputError where it is damaged."""
        raise NotImplementedError

    def taken_ns(self, topic: str, entry: Entry) -> int:
        """The stamp in the image's header, nanoseconds; 0 where there is none."""
        return 0

    def name(self, entry: Entry) -> str:
        """What to call the image: its time, as ROS prints it."""
        return f"{entry.stamp_ns // 10**9}.{entry.stamp_ns % 10**9:09d}"

    def fingerprint(self, entry: Entry) -> str:
        """Tells an image from what takes its place later, unread: of a bag its size and a digest of its two ends."""
        if self._fingerprint is None:
            size = self.path.stat().st_size
            digest = hashlib.sha256()
            with open_outside(self.path) as file:
                for start in (0, max(0, size - _END_BYTES)):
                    file.seek(start)
                    digest.update(file.read(_END_BYTES))
            self._fingerprint = f"{size} {digest.hexdigest()[:16]}"
        return self._fingerprint

    def identity(self, entry: Entry) -> str:
        """Tells the image from any other, wherever its recording is moved to, as far as it can be told unread."""
        return str(entry.stamp_ns)

    def close(self) -> None:
        """Close the file; it is opened again when needed."""
        forget(self)
        file, self._file = self._file, None
        if file is not None:
            file.close()

    def __getstate__(self) -> dict[str, Any]:
        return {**self.__dict__, "_file": None, "path": self.path.absolute()}  # a worker may stand elsewhere


class BagSource(Source):
    """A file of serialized messages.

    encodings: image topics → "cdr" or "ros1".
    """

    def __init__(self, path: Path) -> None:
        super().__init__(path)
        self.encodings: dict[str, str] = {}
        self._videos: dict[str, VideoDecoder] = {}

    @cached_property
    def bytes_on_disk(self) -> int:
        """Of the file as the user has it, packed or not: so few bytes cannot hold an image of any size."""
        return self.path.stat().st_size

    def read(self, topic: str, entry: Entry) -> bytes:
        """The serialized message. Raises InputError where it is damaged."""
        raise NotImplementedError

    def message(self, topic: str, entry: Entry) -> Message:
        """The message, with the attributes its ROS definition names. Raises InputError."""
        try:
            content = self.read(topic, entry)
        except OSError as error:
            raise InputError(f"{self.path} cannot be read: {error.strerror or error}") from None
        if self.encodings[topic] == "cdr" and content[:4] == ZSTD_MAGIC:  # rosbag2's compression by message
            content = decompress(content, "zstd", MAX_MESSAGE_BYTES)
        message = deserialize(content, self.topics[topic], self.encodings[topic])
        if self.topics[topic] == IMAGE:
            width, height = int(message.width), int(message.height)
            if width * height > MAX_PIXELS_OF_FEW_BYTES:
                check_size(width, height, self.bytes_on_disk)
        return message

    def grey(self, topic: str, entry: Entry) -> np.ndarray:
        message = self.message(topic, entry)
        if self.topics[topic] == IMAGE:
            return grey_image(message)
        if packet_of(message, self.topics[topic]) is not None:
            return grey_of(self._video(topic).frame(self._number(topic, entry)))
        return grey_of_samples(decoded_file(as_bytes(message.data)))

    def picture(self, topic: str, entry: Entry) -> Picture:
        message = self.message(topic, entry)
        if self.topics[topic] == IMAGE:
            return decode_picture(message)
        if packet_of(message, self.topics[topic]) is not None:
            return Picture(colours_of(self._video(topic).frame(self._number(topic, entry))), "bgr8")
        return decode_compressed_picture(message)

    def taken_ns(self, topic: str, entry: Entry) -> int:
        message = self.message(topic, entry)
        stamp = message.timestamp if hasattr(message, "timestamp") else message.header.stamp
        return int(stamp.sec) * 10**9 + int(stamp.nanosec)

    def _number(self, topic: str, entry: Entry) -> int:
        """The place of an image among those of its topic."""
        entries = self.entries[topic]
        place = bisect.bisect_left(entries, entry.stamp_ns, key=lambda candidate: candidate.stamp_ns)
        return entries.index(entry, place)

    def _video(self, topic: str) -> VideoDecoder:
        if topic not in self._videos:

            def packet(number: int) -> Packet:
                video_packet = packet_of(self.message(topic, self.entries[topic][number]), self.topics[topic])
                if video_packet is None:
                    raise InputError("a message among those of a video holds none")
                return video_packet

            self._videos[topic] = VideoDecoder(packet, len(self.entries[topic]), topic, self.topics[topic])
        return self._videos[topic]

    def __getstate__(self) -> dict[str, Any]:
        return {**super().__getstate__(), "_videos": {}}

    def _stream(self) -> BinaryIO:
        file: BinaryIO | None = self._file
        if file is None:
            self._file = file = open_outside(self.path)
        note_use(self)
        return file

    def _add_topic(self, topic: str, type_name: str, encoding: str) -> bool:
        """Note a topic; True where its images can be read."""
        self.topics[topic] = one_line(ros2_type(type_name), _LONGEST_NAME)
        if self.topics[topic] not in IMAGE_TYPES or encoding not in ("cdr", "ros1"):
            return False
        self.encodings[topic] = encoding
        self.entries.setdefault(topic, [])
        return True


def topic_name(name: str) -> str:
    """A topic's name as it is called from here on: a line that can be printed."""
    return one_line(name, _LONGEST_NAME)


def ros2_type(name: str) -> str:
    """ROS 1 writes pkg/Name, ROS 2 pkg/msg/Name."""
    parts = name.split("/")
    return f"{parts[0]}/msg/{parts[1]}" if len(parts) == 2 else name
