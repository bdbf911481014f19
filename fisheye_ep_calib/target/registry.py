"""From a target file to a Target. A new target is one module and one line here."""

from __future__ import annotations

import os
from dataclasses import replace
from os import PathLike

from fisheye_ep_calib.errors import InputError
from fisheye_ep_calib.outside import checked_path, expanded
from fisheye_ep_calib.plain_text import one_line, shown
from fisheye_ep_calib.target.base import Target
from fisheye_ep_calib.target.boards.aprilgrid import AprilGrid
from fisheye_ep_calib.target.boards.charuco import Charuco
from fisheye_ep_calib.target.boards.chessboard import Chessboard
from fisheye_ep_calib.target.boards.circle_grid import CircleGrid
from fisheye_ep_calib.target.schema import MOST_POINTS, Keys
from fisheye_ep_calib.target.shape.content import parse_board, parse_shape
from fisheye_ep_calib.target.shape.measured import BoardShape
from fisheye_ep_calib.target.shipped import find_target_file, shipped_files
from fisheye_ep_calib.yaml_file import read_yaml

SHAPE = "shape"  # the key of every kind of target for a shape that was measured (shape/content.py)
TARGETS: dict[str, type[Target]] = {kind.kind: kind for kind in (CircleGrid, Chessboard, Charuco, AprilGrid)}


def load_target(path: str | PathLike[str] | Target) -> Target:
    """Read a target file.

    Args:
        path: YAML with this project's keys or Kalibr's; a bare name finds a shipped one. A Target is returned as it is.

    Returns:
        The target: its points, and how it is found in an image and printed.

    Raises:
        InputError: The file, or a key of it that is named, cannot be used.
    """
    if isinstance(path, Target):
        return path
    path = find_target_file(expanded(checked_path(path, "path")))
    if not os.path.exists(path):  # of a name that no file can have, too
        raise InputError(
            f"cannot read target file {one_line(path)}: it is not there; shipped, by name: {', '.join(shipped_files())}"
        )
    return parse_target(read_yaml(path, "target"), one_line(path), path.stem)


def load_shape(path: str | PathLike[str]) -> BoardShape:
    """The measured shape that a target file or a camera file holds. Raises InputError in one line."""
    path = find_target_file(expanded(path))
    values = read_yaml(path, "target")
    try:
        camera = values.get("entrance_pupil") if isinstance(values, dict) else None
        if isinstance(camera, dict):
            return parse_board((camera.get("calibration") or {}).get("board"))
        shape = parse_target(values, str(path), path.stem).shape
    except (InputError, AttributeError) as error:
        raise InputError(f"{path}: {error}") from None
    if shape is None:
        raise InputError(f"{path} has no key {SHAPE}: no shape was measured")
    return shape


def parse_target(values: object, source: str = "target", name: str = "target") -> Target:
    """Make a target from a target file's keys. ``source`` leads the error messages."""
    if not isinstance(values, dict):
        raise InputError(f"{source}: a target file is a list of keys and values, such as 'type: circle_grid'")
    own = {key: value for key, value in values.items() if key != SHAPE}
    keys = Keys(own, source)
    if "type" in keys and "target_type" in keys:
        raise InputError(f"{source}: give type (this project's keys) or target_type (Kalibr's), not both")
    if "target_type" in keys:
        readers = {target.kalibr_kind: target.from_kalibr for target in TARGETS.values() if target.kalibr_kind}
        chosen = keys.get("target_type")
    elif "type" in keys:
        readers = {kind: target.from_keys for kind, target in TARGETS.items()}
        chosen = keys.get("type")
    else:
        raise InputError(f"{source}: type is missing; known: {', '.join(TARGETS)}")
    kind = next((name for name in readers if isinstance(chosen, str) and same_kind(name, chosen)), None)
    if kind is None:
        raise InputError(f"{source}: unknown type {shown(chosen)}; known: {', '.join(readers)}")
    target = replace(readers[kind](keys, name), keys=own)
    if len(target.object_points) > MOST_POINTS:
        raise InputError(
            f"{source}: columns × rows give {len(target.object_points)} points; at most {MOST_POINTS} are read"
        )
    if values.get(SHAPE) is None:
        return target
    try:
        return replace(target, shape=_shape_of(values[SHAPE], target))
    except InputError as error:
        raise InputError(f"{source}: {error}") from None


def same_kind(first: str, second: str) -> bool:
    """Whether two names mean one kind: in other capitals, without the underscore, or checkerboard for chessboard."""

    def plain(name: str) -> str:
        return name.lower().replace("_", "").replace("-", "").replace("chess", "checker")

    return plain(first) == plain(second)


def _shape_of(content: object, target: Target) -> BoardShape:
    return replace(parse_shape(content, target.object_points), discs=target.disc_radius is not None)
