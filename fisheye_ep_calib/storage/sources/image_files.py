"""Image files on disk, taken as one camera's recording."""

from __future__ import annotations

import re
from collections.abc import Iterable
from pathlib import Path

import numpy as np

from fisheye_ep_calib.errors import InputError
from fisheye_ep_calib.storage.images import decode_file_content
from fisheye_ep_calib.storage.pictures import Picture, decode_picture_content
from fisheye_ep_calib.storage.sources.base import Entry, Source
from fisheye_ep_calib.storage.sources.image_names import times_in_names

SUFFIXES = frozenset({".png", ".jpg", ".jpeg", ".bmp", ".tif", ".tiff"})
IMAGE_FILE = "image file"
MAX_FILE_BYTES = 2**30


class ImageFiles(Source):
    """An entry's location is (number of the file,); its time is that of the file's name, or that number."""

    def __init__(self, topic: str, files: Iterable[Path]) -> None:
        self.files = sorted(files, key=natural_order)
        super().__init__(self.files[0].parent)
        self.topics[topic] = IMAGE_FILE
        times = times_in_names([file.name for file in self.files])
        self.timed = times is not None
        entries = [Entry(time, (number,)) for number, time in enumerate(times or range(len(self.files)))]
        self.entries[topic] = sorted(entries)

    def name(self, entry: Entry) -> str:
        return self.files[entry.location[0]].name

    def identity(self, entry: Entry) -> str:
        return str(self.files[entry.location[0]].absolute())  # files carry no time

    def fingerprint(self, entry: Entry) -> str:
        try:
            found = self.files[entry.location[0]].stat()
        except OSError:
            return ""
        return f"{found.st_size} {found.st_mtime_ns}"

    def __getstate__(self) -> dict:
        return {**super().__getstate__(), "files": [file.absolute() for file in self.files]}

    def image(self, topic: str, entry: Entry) -> np.ndarray:
        return decode_file_content(self._content(entry))

    def picture(self, topic: str, entry: Entry) -> Picture:
        return decode_picture_content(self._content(entry))

    def _content(self, entry: Entry) -> bytes:
        path = self.files[entry.location[0]]
        try:
            if path.stat().st_size > MAX_FILE_BYTES:
                raise InputError("the file is too large for an image")
            return path.read_bytes()
        except OSError as error:
            raise InputError(f"the file cannot be read ({error.strerror or error})") from None


def is_image_file(path: Path) -> bool:
    return path.suffix.lower() in SUFFIXES and not path.name.startswith(".") and path.is_file()


def natural_order(path: Path) -> tuple:
    """Sorts img2 before img10."""
    parts = re.split(r"(\d+)", path.name)
    return [(int(part), "") if part.isdecimal() else (-1, part) for part in parts], path.name
