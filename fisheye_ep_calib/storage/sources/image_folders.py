"""From folders of images to cameras: one folder each, one folder of folders, or several cameras in one folder."""

from __future__ import annotations

import os
import re
from collections import Counter
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

from fisheye_ep_calib.errors import InputError
from fisheye_ep_calib.outside import read_outside
from fisheye_ep_calib.storage.image_header import declared_size
from fisheye_ep_calib.storage.sources.base import topic_name
from fisheye_ep_calib.storage.sources.image_files import MAX_FILE_BYTES, ImageFiles, is_image_file, natural_order
from fisheye_ep_calib.storage.sources.image_names import cameras_in_names

_DEEPEST = 4  # folders within folders: mav0/cam0/data, camera/left/images/png
_MOST_FOLDERS = 10_000
# What folders are called for what they hold, whichever camera took it.
_PLAIN_NAMES = frozenset(
    "data image images image_raw image_mono image_color img imgs frame frames raw rgb color grey gray mono "
    "png jpg jpeg bmp tif tiff calib calibration mav0".split()
)
_CAMERA_NAME = re.compile(
    r"(?:.*[^a-z])?"
    r"(?:(?:cam|camera|fisheye|fish|lens|sensor|gopro|webcam|device)[ _-]*[\da-h]|left|right|front|rear|back)"
    r"(?:[^a-z].*)?"
)


@dataclass(frozen=True)
class ImageFolder:
    """Image files that lie together. name: what to call their camera, once that is clear.

    within: the folders down to them from the one that the user named, outermost first. archive: what they were unpacked
    from, and where to.
    """

    path: Path
    files: tuple[Path, ...]
    within: tuple[str, ...] = ()
    name: str = ""
    archive: tuple[Path, Path] | None = None


def image_folders(folder: Path) -> list[ImageFolder]:
    """The images in a folder or else, named apart, those in the folders within it; none where there are none.

    Raises InputError where a folder cannot be read, or there are folders without end.
    """
    here = _images_in(folder)
    if here:
        return [ImageFolder(folder, here)]
    folders: list[ImageFolder] = []
    below: list[tuple[Path, tuple[str, ...]]] = [(folder, ())]
    visited = 0
    for _ in range(_DEEPEST):
        level: list[tuple[Path, tuple[str, ...]]] = []
        for path, within in below:
            level += [(images, (*within, images.name)) for images in _folders_in(path)]
        visited += len(level)
        if visited > _MOST_FOLDERS:
            raise InputError(f"{folder} holds more than {_MOST_FOLDERS} folders: name those with the images")
        with_images = [ImageFolder(path, _images_in(path), within) for path, within in level]
        folders += [images for images in with_images if images.files]
        below = [(images.path, images.within) for images in with_images if not images.files]
    return _named_apart(sorted(folders, key=lambda images: [natural_order(Path(part)) for part in images.within]))


def image_sources(folders: Sequence[ImageFolder], notes: list[str], problems: list[str]) -> list[ImageFiles]:
    """One source a camera and folder. notes: how images were told apart, for the user; problems: what is left out."""
    sources = []
    for folder in _named_by_themselves(folders):
        by_name = cameras_in_names([file.name for file in folder.files], lambda place: _size(folder.files[place]))  # noqa: B023
        if by_name is None:
            sources.append(ImageFiles(topic_name(folder.name), folder.files, folder.archive))
            continue
        prefix = f"{folder.name}_" if len(folders) > 1 else ""
        for camera, places in by_name.numbers.items():
            sources.append(
                ImageFiles(topic_name(prefix + camera), [folder.files[place] for place in places], folder.archive)
            )
        cameras = ", ".join(f"{prefix}{camera} ({len(places)} images)" for camera, places in by_name.numbers.items())
        place = folder.path if folder.archive is None else folder.archive[0]
        notes.append(f"{place}: by their names its images are of {len(by_name.numbers)} cameras: {cameras}")
        if by_name.strays:
            strays = ", ".join(folder.files[place].name for place in by_name.strays)
            problems.append(f"{place}: {strays}: of none of its cameras by name, left out")
    return sources


def _images_in(folder: Path) -> tuple[Path, ...]:
    return tuple(sorted((path for path in _contents(folder) if is_image_file(path)), key=natural_order))


def _folders_in(folder: Path) -> list[Path]:
    return [path for path in _contents(folder) if path.is_dir() and not path.name.startswith(".")]


def _contents(folder: Path) -> list[Path]:
    try:
        return sorted(map(Path, (entry.path for entry in os.scandir(folder))), key=natural_order)
    except OSError as error:
        raise InputError(f"{folder} cannot be read: {error.strerror or error}") from None


def _named_apart(folders: list[ImageFolder]) -> list[ImageFolder]:
    """Each named by the one part of its path that names a camera, or by what sets its path apart from the others'."""
    marks = [[part for part in folder.within if _is_camera(part)] for folder in folders]
    if folders and all(len(mark) == 1 for mark in marks):
        return [replace(folder, name=mark[0]) for folder, mark in zip(folders, marks, strict=True)]
    shared = len(os.path.commonprefix([folder.within[:-1] for folder in folders]))
    short = ["_".join(_without_plain(folder.within[shared:]) or folder.within[-1:]) for folder in folders]
    taken = Counter(short)
    return [
        replace(folder, name=name if taken[name] == 1 else "_".join(folder.within))
        for folder, name in zip(folders, short, strict=True)
    ]


def _named_by_themselves(folders: Sequence[ImageFolder]) -> list[ImageFolder]:
    """Folders that the user named are called what they are called or, where that says nothing, what holds them is."""
    parents = {folder.path.absolute().parent for folder in folders if not folder.name}
    named = []
    for folder in folders:
        own, parent = folder.path.absolute().name or "images", folder.path.absolute().parent.name
        plain = own.lower() in _PLAIN_NAMES and parent
        name = parent if plain and (_is_camera(parent) or len(parents) > 1) else own
        named.append(folder if folder.name else replace(folder, name=name))
    return named


def _is_camera(part: str) -> bool:
    return _CAMERA_NAME.fullmatch(part.lower()) is not None


def _without_plain(parts: Iterable[str]) -> list[str]:
    return [part for part in parts if part.lower() not in _PLAIN_NAMES]


def _size(path: Path) -> tuple[int, int] | None:
    try:
        return declared_size(read_outside(path, MAX_FILE_BYTES))
    except InputError:
        return None
