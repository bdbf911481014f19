"""From what the user names, a file, a folder or a pattern, to the sources it holds."""

from __future__ import annotations

import glob
import importlib
import importlib.util
import os
import sys
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import NamedTuple

from fisheye_ep_calib.errors import InputError
from fisheye_ep_calib.outside import open_outside, real_path
from fisheye_ep_calib.plain_text import one_line
from fisheye_ep_calib.storage.budget import Budget
from fisheye_ep_calib.storage.compression import ZSTD_MAGIC, decompress_file
from fisheye_ep_calib.storage.scratch import Scratch
from fisheye_ep_calib.storage.sources.base import BagSource, Source
from fisheye_ep_calib.storage.sources.copies import without_copies
from fisheye_ep_calib.storage.sources.image_archive import archive_stem, is_archive, unpack_images
from fisheye_ep_calib.storage.sources.image_files import SUFFIXES, is_image_file, natural_order
from fisheye_ep_calib.storage.sources.image_folders import ImageFolder, image_folders, image_sources
from fisheye_ep_calib.yaml_file import read_yaml

MAX_METADATA_BYTES = 2**24
_NAMES_TOLD = 5


class BagFormat(NamedTuple):
    """A kind of file: its ending, its first bytes, and the subclass of Source that reads it.

    Its module is imported when first needed: folders of images are read without the packages that bags want.
    """

    suffix: str
    magic: bytes
    module: str
    source: str

    def open(self, path: Path, budget: Budget) -> Source:
        source = self.source
        try:
            loaded = importlib.import_module(self.module)
        except ModuleNotFoundError as error:
            if self.suffix not in _READ_BY_ROS or not _has_ros_reader():
                raise InputError(
                    f"{path}: reading it needs the Python package {error.name}: pip install {error.name}"
                ) from None
            loaded, source = importlib.import_module(f"{_HERE}.ros_bag"), "RosBag"
        opened: Source = getattr(loaded, source).open(path, budget)
        return opened


def _has_ros_reader() -> bool:
    try:
        return importlib.util.find_spec("rosbag2_py") is not None
    except ValueError:  # somebody put something else in its place
        return "rosbag2_py" in sys.modules


_READ_BY_ROS = (".mcap",)  # where the package that reads them is missing
_HERE = "fisheye_ep_calib.storage.sources"
BAG_FORMATS: dict[str, BagFormat] = {
    kind.suffix: kind
    for kind in (
        BagFormat(".mcap", b"\x89MCAP0\r\n", f"{_HERE}.mcap_file", "McapFile"),
        BagFormat(".db3", b"SQLite format 3\0", f"{_HERE}.db3_file", "Db3File"),
        BagFormat(".bag", b"#ROSBAG V2.0\n", f"{_HERE}.bag_file", "BagFile"),
    )
}


class Found(NamedTuple):
    """problems: what of the sources is lost. notes: how their images were told apart. Both in words."""

    sources: list[Source]
    problems: list[str]
    notes: list[str]


def find_sources(paths: Sequence[str | os.PathLike[str]], scratch: Scratch) -> Found:
    """The sources that ``paths`` name.

    scratch: the place of what must be decompressed before it can be read. Raises InputError where nothing is.
    """
    if not paths:
        raise InputError("no recording is named")
    budget = Budget()
    sources: list[Source] = []
    problems: list[str] = []
    notes: list[str] = []
    folders: list[ImageFolder] = []
    loose_images: list[Path] = []
    try:
        for path in _expand(paths):
            if is_image_file(path):
                loose_images.append(path)
            elif is_archive(path) and path.is_file():
                folders += _images_of_archive(path, scratch, problems, budget)
            elif path.is_dir():
                bags = _bags_in(path)
                if bags is None:
                    folders += _images_within(path)
                else:
                    sources += _sources_of_bag_folder(path, bags, scratch, problems, budget)
            else:
                sources.append(_open_bag(path, scratch, problems, budget))
        taken = {real_path(file) for folder in folders for file in folder.files}
        loose_images = [path for path in loose_images if real_path(path) not in taken]
        by_folder: dict[Path, list[Path]] = {}
        for path in loose_images:
            by_folder.setdefault(path.parent, []).append(path)
        folders += [ImageFolder(folder, tuple(files)) for folder, files in by_folder.items()]
        sources += image_sources(folders, notes, problems)
        for source in sources:
            problems += source.problems
        problems += without_copies([source for source in sources if isinstance(source, BagSource)])
    except BaseException:
        for source in sources:
            source.close()
        raise
    return Found(sources, problems, notes)


def _expand(paths: Sequence[str | os.PathLike[str]]) -> list[Path]:
    """Patterns become the files they match; every other path must exist."""
    expanded = []
    for name in paths:
        path = Path(name)
        if os.path.exists(path):
            expanded.append(path)
            continue
        matches = sorted(map(Path, _matches(os.fspath(name))), key=natural_order)
        if not matches:
            raise InputError(f"{name} does not exist")
        expanded += matches
    each: dict[Path, Path] = {}
    for path in expanded:
        each.setdefault(real_path(path), path)
    return list(each.values())


def _matches(pattern: str) -> list[str]:
    """As ``glob.glob`` with ** for folders within folders, each once: there is no end of links to what holds them."""
    head, stars, tail = pattern.partition("**")
    if not stars or (head and not head.endswith(("/", os.sep))) or (tail and not tail.startswith(("/", os.sep))):
        return glob.glob(pattern)
    matches: list[str] = []
    seen: set[str] = set()
    for start in glob.glob(head) if head else [os.curdir]:
        for place, folders, files in os.walk(start, followlinks=True):
            folders[:] = [name for name in folders if not name.startswith(".")]
            if (real := os.path.realpath(place)) in seen:
                folders.clear()
                continue
            seen.add(real)
            if tail.strip(f"/{os.sep}"):
                matches += glob.glob(glob.escape(place) + tail)
                continue
            matches += [place] if place != os.curdir else []
            matches += [os.path.join(place, name) for name in files if not tail and not name.startswith(".")]
    return matches


def _bags_in(folder: Path) -> list[Path] | None:
    """The bag files of a folder; None where it is one of images."""
    try:
        contents = sorted(folder.iterdir(), key=natural_order)
    except OSError as error:
        raise InputError(f"{folder} cannot be read: {error.strerror or error}") from None
    bags = [path for path in contents if path.is_file() and bag_suffix(path)]
    unpacked = {path.with_suffix("") for path in bags if path.suffix == ".zstd"}  # players leave these beside
    bags = [path for path in bags if path not in unpacked]
    has_images = any(is_image_file(path) for path in contents)
    return bags if bags or (not has_images and (folder / "metadata.yaml").exists()) else None


def _images_within(folder: Path) -> list[ImageFolder]:
    folders = image_folders(folder)
    if not folders:
        raise InputError(
            f"{folder} holds neither a bag ({', '.join(BAG_FORMATS)}) nor images ({', '.join(sorted(SUFFIXES))})"
        )
    return folders


def _images_of_archive(path: Path, scratch: Scratch, problems: list[str], budget: Budget) -> list[ImageFolder]:
    folder = scratch.path / f"{len(list(scratch.path.iterdir()))}_images"
    unpack_images(path, folder, problems, budget)
    name = archive_stem(path)
    return [
        replace(images, archive=(path, folder), name=images.name if images.path != folder else name)
        for images in image_folders(folder)
    ]


def _sources_of_bag_folder(
    folder: Path, bags: list[Path], scratch: Scratch, problems: list[str], budget: Budget
) -> list[Source]:
    """The files of a rosbag2 folder, or ROS 1 bags side by side; an unreadable one spares the others."""
    damage: list[str] = []
    listed = _files_listed(folder, damage)
    missing = [name for name in listed if not os.path.exists(folder / name)]
    complete = {name.removesuffix(".zstd") for name in listed}
    strange = [path.name for path in bags if listed and path.name.removesuffix(".zstd") not in complete]
    if strange:
        problems.append(f"{folder}: {_some(strange)} not listed in metadata.yaml, but read too")
    if missing:
        problems.append(f"{folder}: {_some(missing)} listed in metadata.yaml but not there")
    sources: list[Source] = []
    failures = []
    for path in bags:
        try:
            sources.append(_open_bag(path, scratch, problems, budget))
        except InputError as error:
            failures.append(str(error))
    if not sources:
        raise InputError((failures + problems + [f"{folder} holds no bag file"])[0])
    problems += failures + damage
    return sources


def _some(names: Sequence[str]) -> str:
    """The first of the names in a line, and how many more there are."""
    more = f" and {len(names) - _NAMES_TOLD} more" if len(names) > _NAMES_TOLD else ""
    return ", ".join(one_line(name, 100) for name in names[:_NAMES_TOLD]) + more


def _files_listed(folder: Path, problems: list[str]) -> list[str]:
    """The storage files that metadata.yaml names; none where it is absent or damaged: only lost files need it."""
    path = folder / "metadata.yaml"
    if not path.exists():
        return []
    try:
        metadata = read_yaml(path, "metadata", most=MAX_METADATA_BYTES)
        names = metadata["rosbag2_bagfile_information"]["relative_file_paths"]
        return [Path(name).name for name in names]
    except (InputError, KeyError, TypeError, ValueError):
        problems.append(f"{path} is damaged: whether files of the bag are missing cannot be told")
        return []


def bag_suffix(path: Path) -> str:
    """A key of BAG_FORMATS, also under .zstd or, while it is recorded, .active; empty for any other file."""
    name = path.with_suffix("") if path.suffix.lower() in (".zstd", ".active") else path
    suffix = name.suffix.lower()
    return suffix if suffix in BAG_FORMATS else ""


def _open_bag(path: Path, scratch: Scratch, problems: list[str], budget: Budget) -> Source:
    """A bag by what its first bytes say it is, or else by its name."""
    start, size = _first_bytes(path), path.stat().st_size
    if not start:
        raise InputError(f"{path} is empty")
    if start.startswith(ZSTD_MAGIC):
        packed, path = path, _decompressed(path, scratch, problems, budget)
        if path.stat().st_size == 0:
            raise InputError(f"{packed} is empty or damaged")
        start = _first_bytes(path)
    by_magic = [bag_format for bag_format in BAG_FORMATS.values() if start.startswith(bag_format.magic)]
    by_name = [BAG_FORMATS[suffix] for suffix in [bag_suffix(path)] if suffix]
    for bag_format in by_magic + by_name:
        source = bag_format.open(path, budget)
        if isinstance(source, BagSource):
            source.bytes_on_disk = size
        return source
    raise InputError(f"{path} is neither a bag ({', '.join(BAG_FORMATS)}) nor an image nor a folder of either")


def _first_bytes(path: Path) -> bytes:
    try:
        with open_outside(path) as file:
            return file.read(16)
    except OSError as error:
        raise InputError(f"{path} cannot be read: {error.strerror or error}") from None


def _decompressed(path: Path, scratch: Scratch, problems: list[str], budget: Budget) -> Path:
    """A .zstd file's content as a file in ``scratch``."""
    destination = scratch.path / f"{len(list(scratch.path.iterdir()))}_{path.stem}"
    problem = decompress_file(path, destination, budget)
    if problem:
        problems.append(problem)
    return destination
