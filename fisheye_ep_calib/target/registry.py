"""From a target file to a Target. A new target is one module and one line here."""

from __future__ import annotations

from os import PathLike
from pathlib import Path

import yaml

from fisheye_ep_calib.errors import InputError
from fisheye_ep_calib.target.aprilgrid import AprilGrid
from fisheye_ep_calib.target.base import Target
from fisheye_ep_calib.target.charuco import Charuco
from fisheye_ep_calib.target.chessboard import Chessboard
from fisheye_ep_calib.target.circle_grid import CircleGrid
from fisheye_ep_calib.target.schema import Keys

TARGETS = (CircleGrid, Chessboard, Charuco, AprilGrid)

LARGEST_FILE = 1 << 20


def load_target(path: str | PathLike) -> Target:
    """Read a target file (YAML): this project's keys or Kalibr's. Raises InputError in one line."""
    path = Path(path)
    try:
        if path.stat().st_size > LARGEST_FILE:
            raise InputError(f"{path}: too large for a target file")
        values = yaml.safe_load(path.read_text(encoding="utf-8"))
    except OSError as error:
        raise InputError(f"cannot read target file {path}: {error.strerror or error}") from error
    except UnicodeDecodeError as error:
        raise InputError(f"{path}: not a text file") from error
    except (yaml.YAMLError, RecursionError) as error:
        mark = getattr(error, "problem_mark", None)
        where = f" (line {mark.line + 1})" if mark else ""
        raise InputError(f"{path}: not valid YAML{where}") from error
    return parse_target(values, str(path), path.stem)


def parse_target(values, source: str = "target", name: str = "target") -> Target:
    """Make a target from a target file's keys. ``source`` leads the error messages."""
    if not isinstance(values, dict):
        raise InputError(f"{source}: a target file is a list of keys and values, such as 'type: circle_grid'")
    keys = Keys(values, source)
    if "type" in keys and "target_type" in keys:
        raise InputError(f"{source}: give type (this project's keys) or target_type (Kalibr's), not both")
    if "target_type" in keys:
        known = {target.kalibr_kind: target.from_kalibr for target in TARGETS if target.kalibr_kind}
        chosen = keys.get("target_type")
    elif "type" in keys:
        known = {target.kind: target.from_keys for target in TARGETS}
        chosen = keys.get("type")
    else:
        raise InputError(f"{source}: type is missing; known: {', '.join(target.kind for target in TARGETS)}")
    if not isinstance(chosen, str) or chosen not in known:
        raise InputError(f"{source}: unknown type {chosen!r}; known: {', '.join(known)}")
    return known[chosen](keys, name)
