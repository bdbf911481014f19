"""Image files on disk, taken as one camera's recording."""

from __future__ import annotations

import contextlib
import mmap
import re
import struct
from collections.abc import Iterable
from pathlib import Path
from typing import Any

import numpy as np

from fisheye_ep_calib.errors import InputError
from fisheye_ep_calib.outside import open_outside, read_outside
from fisheye_ep_calib.storage.images import decoded_file, decoded_page, grey_of_samples
from fisheye_ep_calib.storage.pictures import Picture, picture_of
from fisheye_ep_calib.storage.sources.base import MAX_MESSAGE_BYTES, Entry, Source
from fisheye_ep_calib.storage.sources.image_names import times_in_names
from fisheye_ep_calib.storage.tiff_pages import MAGICS, Page, pages

_TIFF = frozenset({".tif", ".tiff"})
SUFFIXES = frozenset({".png", ".jpg", ".jpeg", ".bmp", ".webp", ".pgm", ".ppm", ".pnm", ".pbm"}) | _TIFF
IMAGE_FILE = "image file"
MAX_FILE_BYTES = MAX_MESSAGE_BYTES  # an image on disk is read whole as well


class ImageFiles(Source):
    """An entry's location is (number of the file, page in it); its time is that of the file's name, or its place.

    archive: where the files were unpacked from, and the folder they were unpacked to.
    """

    def __init__(self, topic: str, files: Iterable[Path], archive: tuple[Path, Path] | None = None) -> None:
        self.files = sorted(files, key=natural_order)
        self.archive = archive
        super().__init__(self.files[0].parent if archive is None else archive[0])
        self.topics[topic] = IMAGE_FILE
        self._pages = [_pages(file) for file in self.files]
        places = [(number, page.number) for number, pages in enumerate(self._pages) for page in pages]
        times = times_in_names([file.name for file in self.files]) if len(places) == len(self.files) else None
        self.timed = times is not None
        entries = [Entry(time, place) for place, time in zip(places, times or range(len(places)), strict=True)]
        self.entries[topic] = sorted(entries)

    def name(self, entry: Entry) -> str:
        number, page = entry.location
        file = self.files[number]
        return file.name if len(self._pages[number]) == 1 else f"{file.stem}_page{page + 1}{file.suffix}"

    def identity(self, entry: Entry) -> str:
        number, page = entry.location
        file = self.files[number].absolute()  # files carry no time
        within = "" if len(self._pages[number]) == 1 else f"#{page}"
        if self.archive is None:
            return f"{file}{within}"
        archive, folder = self.archive
        return f"{archive.absolute()}!{file.relative_to(folder.absolute())}{within}"

    def fingerprint(self, entry: Entry) -> str:
        try:
            status = (self.files[entry.location[0]] if self.archive is None else self.archive[0]).stat()
        except OSError:
            return ""
        return f"{status.st_size} {status.st_mtime_ns}"

    def __getstate__(self) -> dict[str, Any]:
        archive = None if self.archive is None else (self.archive[0].absolute(), self.archive[1].absolute())
        return {**super().__getstate__(), "files": [file.absolute() for file in self.files], "archive": archive}

    def grey(self, topic: str, entry: Entry) -> np.ndarray:
        return grey_of_samples(self._samples(entry))

    def picture(self, topic: str, entry: Entry) -> Picture:
        return picture_of(self._samples(entry))

    def _samples(self, entry: Entry) -> np.ndarray:
        number, page = entry.location
        path, pages = self.files[number], self._pages[number]
        try:
            if len(pages) > 1:
                declared = next(candidate for candidate in pages if candidate.number == page)
                return decoded_page(path, page, (declared.width, declared.height), declared.pixel_bytes)
            return decoded_file(read_outside(path, MAX_FILE_BYTES, "image"))
        except OSError as error:
            raise InputError(f"the file cannot be read ({error.strerror or error})") from None


def is_image_file(path: Path) -> bool:
    return path.suffix.lower() in SUFFIXES and not path.name.startswith(".") and path.is_file()


def _pages(path: Path) -> list[Page]:
    """The pages of a TIFF; one, of a size that is read when it is decoded, of any other file."""
    if path.suffix.lower() in _TIFF:
        with contextlib.suppress(OSError, ValueError, InputError, struct.error, OverflowError):
            with open_outside(path) as file, mmap.mmap(file.fileno(), 0, access=mmap.ACCESS_READ) as content:
                if content[:4] in MAGICS and (of_file := pages(content)):
                    return of_file
    return [Page(0, 0, 0)]


def natural_order(path: Path) -> tuple[list[tuple[int, str]], str]:
    """Sorts img2 before img10."""
    parts = re.split(r"(\d+)", path.name)
    return [(int(part), "") if part.isdecimal() else (-1, part) for part in parts], path.name
