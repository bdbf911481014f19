"""calibration.json: what ``calibrate --json`` prints, with inputs, versions and every view's residuals.

``docs/calibration_json.md`` documents the schema, ``docs/calibration.schema.json`` lets programs check it.
"""

from __future__ import annotations

import datetime
import platform
from collections.abc import Mapping
from importlib import metadata
from os import PathLike
from typing import Any

from fisheye_ep_calib.report.data import View
from fisheye_ep_calib.storage.atomic import atomic_write
from fisheye_ep_calib.storage.json_text import readable_json
from fisheye_ep_calib.version import __version__

SCHEMA = 1
_LIBRARIES = ("numpy", "scipy", "opencv-python-headless", "opencv-python", "calib-targets", "rosbags", "mcap")


def versions() -> dict[str, str]:
    """What the result was made with: this program, Python and the libraries that it counts on."""
    of_packages = {"fisheye_ep_calib": __version__, "python": platform.python_version()}
    return of_packages | {name: version for name in _LIBRARIES if (version := _version(name))}


def now() -> str:
    """The time in UTC, to the second."""
    return datetime.datetime.now(datetime.timezone.utc).isoformat(timespec="seconds")


def _in_words(value: Any) -> str:
    if isinstance(value, Mapping):
        return ", ".join(f"{count} {what}" for what, count in value.items()) or "none"
    return " × ".join(map(str, value)) if isinstance(value, list) else str(value)


def inputs_in_words(inputs: Mapping[str, Any]) -> dict[str, str]:
    """Where a result came from, as a page has it: with the time and the versions."""
    told = {key.replace("_", " "): _in_words(value) for key, value in inputs.items()}
    return {**told, "written": now(), **versions()}


def per_view(views: tuple[View, ...]) -> list[dict[str, Any]]:
    """One object a view, in the order of the recording."""
    return [
        {
            "name": view.name,
            "points": view.points,
            "rejected_points": view.rejected,
            "rms_px": view.rms_px,
            "worst_px": view.worst_px,
            "distance_m": view.distance_m,
            "theta_max_rad": view.theta_max,
        }
        for view in views
    ]


def write_record(
    path: str | PathLike[str], cameras: dict[str, dict[str, Any]], failed: dict[str, str], options: dict[str, Any]
) -> None:
    """cameras: name → content. failed: name → why. options: of the command. Written whole or not at all."""
    content = {
        "schema": SCHEMA,
        "date": now(),
        "versions": versions(),
        "options": options,
        "cameras": cameras,
        "failed": failed,
    }
    atomic_write(path, f"{readable_json(content)}\n".encode())


def _version(name: str) -> str | None:
    try:
        return metadata.version(name)
    except metadata.PackageNotFoundError:
        return None
