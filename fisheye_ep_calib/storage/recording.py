"""Recorded images, whatever they are stored in: found by type, in order of time, decoded when asked for."""

from __future__ import annotations

import heapq
import os
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from fisheye_ep_calib.errors import InputError
from fisheye_ep_calib.outside import checked_paths
from fisheye_ep_calib.plain_text import one_line
from fisheye_ep_calib.storage.grey_levels import to_eight_bits, to_levels
from fisheye_ep_calib.storage.pictures import Picture
from fisheye_ep_calib.storage.scratch import Scratch
from fisheye_ep_calib.storage.sources.base import IMAGE_TYPES, Entry, Source
from fisheye_ep_calib.storage.sources.find import find_sources
from fisheye_ep_calib.storage.sources.image_files import IMAGE_FILE
from fisheye_ep_calib.storage.video import VIDEO_TYPES


@dataclass(frozen=True)
class ImageTopic:
    """A topic with images: ``count`` of them, of a ROS message type or image files."""

    name: str
    type: str
    count: int

    def __str__(self) -> str:
        return f"{self.name} ({self.count} × {self.type})"


class DecodedImages:
    """Grey images as they were decoded, for who looks at them again: the first ones, up to so many bytes.

    The first, not the last: who goes through more images than fit, in one order, would never meet one of the last.
    """

    def __init__(self, most_bytes: int = 0) -> None:
        self.most_bytes = most_bytes
        self._kept: dict[tuple[str, int], np.ndarray] = {}
        self._bytes = 0

    def grey(self, topic: str, index: int, decode: Callable[[], np.ndarray]) -> np.ndarray:
        """The image of that number, which nobody may change."""
        kept = self._kept.get((topic, index))
        if kept is not None:
            return kept
        image = decode()
        if self._bytes + image.nbytes <= self.most_bytes:
            image = image.copy()  # a view may hold a whole chunk of a bag
            image.flags.writeable = False
            self._kept[topic, index] = image
            self._bytes += image.nbytes
        return image


@dataclass(frozen=True)
class Frame:
    """One image, not read yet. ``index`` counts the topic's images from 0, in the order of time."""

    topic: str
    index: int
    stamp_ns: int
    name: str
    _source: Source = field(repr=False, compare=False)
    _entry: Entry = field(repr=False, compare=False)
    _decoded: DecodedImages = field(repr=False, compare=False, default_factory=DecodedImages)

    def image(self) -> np.ndarray:
        """Grey (h, w) uint8, read and decoded now. Raises InputError where this one image is damaged."""
        return to_eight_bits(self._grey())

    def levels(self) -> np.ndarray:
        """As ``image`` where that is all there is; of a deeper image the same grey levels, float32, not rounded."""
        return to_levels(self._grey())

    def _grey(self) -> np.ndarray:
        return self._decoded.grey(self.topic, self.index, lambda: self._source.grey(self.topic, self._entry))

    def picture(self) -> Picture:
        """The image with its colours, read and decoded now. Raises InputError where it is damaged."""
        return self._source.picture(self.topic, self._entry)

    @property
    def taken_ns(self) -> int:
        """When the image was taken, by its header, nanoseconds; ``stamp_ns`` where it says nothing. Reads it."""
        return self._source.taken_ns(self.topic, self._entry) or self.stamp_ns


class Recording:
    """Several cameras' images from one or more files. Pickles, so that every worker reads for itself.

    problems: what of the recording is lost, in words; empty for an undamaged one.
    notes: how its images were told apart, in words.
    topics: every topic → its type, those without images too.
    """

    def __init__(
        self,
        sources: Sequence[Source],
        problems: Sequence[str] = (),
        notes: Sequence[str] = (),
        scratch: Scratch | None = None,
    ) -> None:
        self._sources = tuple(sources)
        self._scratch = scratch
        self._decoded = DecodedImages()
        self.problems = tuple(problems)
        self.notes = tuple(notes)
        self.topics: dict[str, str] = {}
        self._frames: dict[str, list[tuple[Source, Entry]]] = {}
        for source in self._sources:
            self.topics.update(source.topics)
            for topic, entries in source.entries.items():
                self._frames.setdefault(topic, []).extend((source, entry) for entry in entries)
        for frames in self._frames.values():
            frames.sort(key=lambda frame: frame[1].stamp_ns)

    def __enter__(self) -> Recording:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def close(self) -> None:
        """Close every file and remove what was decompressed."""
        for source in self._sources:
            source.close()
        if self._scratch is not None:
            self._scratch.close()

    def __getstate__(self) -> dict[str, Any]:
        return {**self.__dict__, "_scratch": None, "_decoded": DecodedImages(self._decoded.most_bytes)}

    @contextmanager
    def keeping_decoded(self, most_bytes: int) -> Iterator[None]:
        """Meanwhile decoded images are kept, up to so many bytes here and in every process that it goes to."""
        self._decoded = DecodedImages(most_bytes)
        try:
            yield
        finally:
            self._decoded = DecodedImages()

    def image_topics(self) -> tuple[ImageTopic, ...]:
        """The topics that hold images, by name."""
        return tuple(
            ImageTopic(name, self.topics[name], len(frames)) for name, frames in sorted(self._frames.items()) if frames
        )

    def count(self, topic: str) -> int:
        """How many images a topic holds."""
        return len(self._frames.get(topic, ()))

    def stamps(self, topic: str) -> list[int]:
        """When each image of a topic was recorded, nanoseconds; 0, 1, 2 … for image files not named by their time."""
        return [entry.stamp_ns for _, entry in self._frames.get(topic, ())]

    def timed(self, topic: str) -> bool:
        """Whether ``stamps`` are of a clock: those of a bag, and of image files whose names are times."""
        return all(source.timed for source, _ in self._frames.get(topic, ()))

    def identities(self, topic: str) -> list[str]:
        """What tells each image of a topic from others, unread: its time, or an image file's path."""
        return [source.identity(entry) for source, entry in self._frames.get(topic, ())]

    def fingerprint(self, topic: str, index: int) -> str:
        """Tells the image of that number from one that takes its place later, unread."""
        source, entry = self._frames[topic][index]
        return source.fingerprint(entry)

    def folders(self, topic: str) -> list[Path]:
        """The folders that hold a topic's image files; none for a bag's topic."""
        if self.topics.get(topic) != IMAGE_FILE:
            return []
        return list(dict.fromkeys(source.path for source, _ in self._frames.get(topic, ())))

    def files(self) -> list[Path]:
        """The files and folders that the images are read from, absolute."""
        return [source.path.absolute() for source in self._sources]

    def frame(self, topic: str, index: int) -> Frame:
        """The image of that number, counted from 0 in the order of time."""
        source, entry = self._frames[topic][index]
        return Frame(topic, index, entry.stamp_ns, one_line(source.name(entry)), source, entry, self._decoded)

    def frames(self, topics: Sequence[str] | None = None) -> Iterator[Frame]:
        """Every image of these topics (default: of all), in the order of time; none is read yet."""
        names = [topic.name for topic in self.image_topics()] if topics is None else topics
        return heapq.merge(*map(self._frames_of, names), key=lambda frame: frame.stamp_ns)

    def _frames_of(self, topic: str) -> Iterator[Frame]:
        return (self.frame(topic, index) for index in range(self.count(topic)))


def open_recording(
    paths: str | os.PathLike[str] | Sequence[str | os.PathLike[str]], *, strict: bool = False
) -> Recording:
    """Open bags, folders of images or patterns such as ``images/*.png``, several of them as one recording.

    Args:
        paths: One of them, or several.
        strict: Refuse a damaged file, which else is used as far as it can be read; ``problems`` says what is lost.

    Returns:
        The recording, to be closed, as ``with`` does.

    Raises:
        InputError: There is nothing to use.
    """
    names = checked_paths(paths, "paths")
    scratch = Scratch()
    recording = Recording((), scratch=scratch)
    try:
        recording = Recording(*find_sources(names, scratch), scratch=scratch)
        if strict and recording.problems:
            raise InputError(_first_of(recording.problems))
        if not recording.image_topics():
            raise InputError(_no_images(recording, ", ".join(map(str, names))))
    except BaseException:
        recording.close()
        raise
    return recording


def choose_topics(recording: Recording, wanted: Sequence[str] = (), several: bool = False) -> tuple[str, ...]:
    """The topics to use: those wanted, or the only one; with ``several`` every camera of a recording of image files.

    Raises InputError that lists the candidates.
    """
    topics = recording.image_topics()
    listed = ", ".join(map(str, topics))
    if not wanted:
        topics = tuple(topic for topic in topics if topic.type not in VIDEO_TYPES) or topics
        if len(topics) == 1 or (several and all(topic.type == IMAGE_FILE for topic in topics)):
            return tuple(topic.name for topic in topics)
        raise InputError(f"the recording has {len(topics)} image topics: {listed}; choose with `topics`")
    chosen = tuple(recorded_topic(recording, name) for name in wanted)
    for name in chosen:
        if name not in {topic.name for topic in topics}:
            kind = recording.topics.get(name)
            problem = f"topic {name} is of type {kind}" if kind else f"there is no topic {name}"
            if kind in (*IMAGE_TYPES, IMAGE_FILE):
                problem = f"topic {name} holds no images"
            raise InputError(f"{problem}; image topics: {listed}")
    return chosen


def recorded_topic(recording: Recording, name: str) -> str:
    """A topic of images by its name with or without "/compressed", whichever was recorded; else the name as it is."""
    there = {topic.name for topic in recording.image_topics()}
    base = name.removesuffix("/compressed")
    return next((candidate for candidate in (name, base, f"{base}/compressed") if candidate in there), name)


def _first_of(problems: Sequence[str]) -> str:
    more = f" (and {len(problems) - 1} more problems)" if len(problems) > 1 else ""
    return problems[0] + more


def _no_images(recording: Recording, names: str) -> str:
    lost = f"; {_first_of(recording.problems)}" if recording.problems else ""
    if not recording.topics:
        return f"{names} holds no messages{lost}"
    topics = [f"{name} ({kind})" for name, kind in sorted(recording.topics.items())]
    shown = ", ".join(topics[:10]) + (f" and {len(topics) - 10} more" if len(topics) > 10 else "")
    return f"{names} holds no images; its topics: {shown}{lost}"
