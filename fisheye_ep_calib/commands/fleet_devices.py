"""Which devices a fleet has: sub-folders, bags and observation files of a folder, or the paths in a list."""

from __future__ import annotations

import glob
import os
import re
from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from fisheye_ep_calib.errors import InputError
from fisheye_ep_calib.outside import read_text_outside, real_path
from fisheye_ep_calib.pipeline.names import numbered_alike, safe_name
from fisheye_ep_calib.storage.sources.find import bag_suffix
from fisheye_ep_calib.storage.sources.image_files import is_image_file, natural_order

MAX_LIST_BYTES = 2**24
_MOST_DEVICES = 10_000
OWN_NAMES = ("logs", "fleet.csv")


@dataclass(frozen=True)
class Device:
    """A device's name, and its recording or observation files."""

    name: str
    sources: tuple[Path, ...]


def find_devices(place: Path, output: Path) -> list[Device]:
    """The devices that a folder holds or a text file lists; ``output`` is none of them. Raises InputError."""
    if place.is_dir():
        paths = [path for path in _entries(place) if real_path(path) != real_path(output)]
        if (place / "metadata.yaml").exists() or (not paths and any(map(is_image_file, place.iterdir()))):
            raise InputError(f"{place} is one recording, which 'calibrate' takes; a fleet is a folder of such folders")
        if not paths:
            raise InputError(f"{place} holds no device: no sub-folder, bag or observation file (.npz)")
    else:
        paths = _listed(place)
    _refuse_listed_twice(paths)
    names = _names(paths)
    for name in names:
        if name in OWN_NAMES:
            raise InputError(f"a device cannot be called {name}: the fleet's results have that name; rename it")
    return [Device(name, tuple(_sources(path))) for name, path in zip(names, paths, strict=True)]


def _entries(folder: Path) -> list[Path]:
    try:
        contents = sorted(folder.iterdir(), key=natural_order)
    except OSError as error:
        raise InputError(f"{folder} cannot be read: {error.strerror or error}") from None
    visible = [path for path in contents if not path.name.startswith(".")]
    return [path for path in visible if path.is_dir() or bag_suffix(path) or path.suffix == ".npz"]


def _listed(path: Path) -> list[Path]:
    """A path a line, relative to the list's folder; a # at a line's start or after a space begins a comment."""
    lines = read_text_outside(path, MAX_LIST_BYTES, "list").splitlines()
    listed = [re.sub(r"(^|\s)#.*", "", line).strip() for line in lines]
    paths = [path.parent / path_text for path_text in listed if path_text]
    if not paths:
        raise InputError(f"{path} lists no device; write a path a line")
    if len(paths) > _MOST_DEVICES:
        raise InputError(f"{path} lists {len(paths)} devices, more than {_MOST_DEVICES}; is it a list of paths?")
    return paths


def absence(device: Device) -> str:
    """Why there is nothing to calibrate, before a process is started for it; empty where there is something."""
    absent = (path for path in device.sources if not os.path.exists(path) and not glob.has_magic(os.fspath(path)))
    return next((f"{path} does not exist" for path in absent), "")


def _sources(path: Path) -> list[Path]:
    """What to calibrate from. A folder of observation files, also of an earlier calibration, is these files."""
    for folder in (path, path / "observations"):
        if folder.is_dir() and (files := sorted(folder.glob("*.npz"), key=natural_order)):
            return files
    return [path]


def _names(paths: Sequence[Path]) -> list[str]:
    """Each path's last part, and as many before it as tell it from the others; a number where none does."""
    parts = [[*path.absolute().parts[1:-1], path.name if path.is_dir() else _stem(path)] for path in paths]
    depth = [1] * len(parts)
    while True:
        names = [safe_name("_".join(part[-count:])) for part, count in zip(parts, depth, strict=True)]
        taken = Counter(name.casefold() for name in names)
        alike = [number for number, name in enumerate(names) if taken[name.casefold()] > 1]
        if not alike:
            return names
        if any(depth[number] >= len(parts[number]) for number in alike):
            return numbered_alike(safe_name(parts[n][-1]) if n in alike else name for n, name in enumerate(names))
        for number in alike:
            depth[number] += 1


def _refuse_listed_twice(paths: Sequence[Path]) -> None:
    for path, times in Counter(map(os.path.abspath, paths)).items():
        if times > 1:
            raise InputError(f"{path} is listed twice; take out one of the lines")


def _stem(path: Path) -> str:
    return path.name[: path.name.lower().rindex(bag_suffix(path))] if bag_suffix(path) else path.stem
