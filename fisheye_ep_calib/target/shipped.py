"""The target files that come with the package, found by their bare names."""

from __future__ import annotations

import functools
import os
from pathlib import Path

PACKAGE = "fisheye_ep_calib"
FOLDER = Path("config") / "targets"


@functools.cache
def shipped_folder() -> Path | None:
    """Where they lie: beside the package in a source tree, or in the share/ of what it is installed in."""
    above = Path(__file__).resolve().parents[2:]
    places = [above[0] / FOLDER, *(folder / "share" / PACKAGE / FOLDER for folder in above)]
    return next((place for place in places if place.is_dir()), None)


def shipped_files() -> dict[str, Path]:
    """The shipped target files by their names, in alphabetical order."""
    folder = shipped_folder()
    return {} if folder is None else {path.stem: path for path in sorted(folder.glob("*.yaml"))}


def find_target_file(name: Path) -> Path:
    """The file of that name or, where there is none, the shipped one that a bare name means; else ``name`` itself."""
    if os.path.isfile(name) or name.parent != Path("."):
        return name
    stem = name.stem if name.suffix in (".yaml", ".yml") else name.name
    return shipped_files().get(stem, name)
