"""ROS 2 bags through ROS's own reader, rosbag2_py: for machines that have ROS and not the package ``mcap``.

It lists images by reading every message, where ``mcap`` reads an index, and gives up at the first damaged byte, where
``mcap_file`` goes on.
"""

from __future__ import annotations

import importlib
from collections import Counter
from pathlib import Path
from typing import Any

from fisheye_ep_calib.errors import InputError, first_line
from fisheye_ep_calib.plain_text import one_line
from fisheye_ep_calib.storage.sources.base import MAX_MESSAGE_BYTES, BagSource, Entry
from fisheye_ep_calib.storage.sources.open_files import note_use

_STORAGE = {".mcap": "mcap", ".db3": "sqlite3"}


class _Reader:
    """rosbag2_py's sequential reader with a place in one topic."""

    def __init__(self, path: Path) -> None:
        rosbag2: Any = importlib.import_module("rosbag2_py")
        self._filter: Any = rosbag2.StorageFilter
        self._reader: Any = rosbag2.SequentialReader()
        storage = rosbag2.StorageOptions(uri=str(path), storage_id=_STORAGE.get(path.suffix.lower(), "mcap"))
        self._reader.open(storage, rosbag2.ConverterOptions("cdr", "cdr"))

    def topics(self) -> list[Any]:
        return list(self._reader.get_all_topics_and_types())

    def only(self, topics: list[str]) -> None:
        self._reader.set_filter(self._filter(topics=topics))

    def seek(self, stamp_ns: int) -> None:
        self._reader.seek(stamp_ns)

    def next(self) -> tuple[str, bytes, int] | None:
        if not self._reader.has_next():
            return None
        topic, content, stamp = self._reader.read_next()
        return topic, content, stamp

    def close(self) -> None:
        self._reader = None


class RosBag(BagSource):
    """An entry's location is (its place among the messages of its topic with the same stamp,)."""

    def list_images(self) -> None:
        try:
            reader = self._bag()
            images = [one.name for one in reader.topics() if self._add_topic(one.name, one.type, "cdr")]
        except InputError:
            raise
        except Exception as error:  # of a plugin written in C++
            raise InputError(f"{self.path} cannot be read by rosbag2: {one_line(first_line(error), 200)}") from None
        if not self.topics:
            raise InputError(f"{self.path} holds no topics")
        if not images:
            return
        reader.only(images)
        counts: Counter[tuple[str, int]] = Counter()
        try:
            while (message := reader.next()) is not None:
                topic, _, stamp = message
                self.budget.enter()
                self.entries[topic].append(Entry(stamp, (counts[topic, stamp],)))
                counts[topic, stamp] += 1
        except RuntimeError as error:
            told = one_line(first_line(error), 200)
            self.problems.append(f"{self.path}: damaged ({told}); the {self.image_count} images before that are used")

    def read(self, topic: str, entry: Entry) -> bytes:
        reader = self._bag()
        try:
            reader.only([topic])
            reader.seek(entry.stamp_ns)
            messages = [reader.next() for _ in range(entry.location[0] + 1)]
        except RuntimeError as error:
            raise InputError(f"the message is damaged ({one_line(first_line(error), 200)})") from None
        message = messages[-1]
        if message is None or message[2] != entry.stamp_ns or len(message[1]) > MAX_MESSAGE_BYTES:
            raise InputError("the message is not there any more, or too large")
        return bytes(message[1])

    def _bag(self) -> _Reader:
        if self._file is None:
            self._file = _Reader(self.path)
        note_use(self)
        reader: _Reader = self._file
        return reader
