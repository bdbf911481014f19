"""A rig on disk: its own YAML, and Kalibr's camchain."""

from __future__ import annotations

import datetime
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from os import PathLike
from pathlib import Path
from typing import Any

import numpy as np
import yaml

from fisheye_ep_calib.camera import FisheyeCamera
from fisheye_ep_calib.errors import InputError
from fisheye_ep_calib.file_values import mapping, matrix, needed
from fisheye_ep_calib.formats.kalibr import camchain
from fisheye_ep_calib.formats.placed_camera import PlacedCamera
from fisheye_ep_calib.outside import checked_path
from fisheye_ep_calib.plain_text import one_line, shown
from fisheye_ep_calib.rig.result import RigCalibration
from fisheye_ep_calib.yaml_file import read_yaml

SCHEMA = 1
RIG, CAMCHAIN = "rig.yaml", "camchain.yaml"
_NOT_RIGID = 1e-6
_FARTHEST = 1e6  # metres
_LONGEST_NAME = 200  # bytes


@dataclass(frozen=True)
class RigFile:
    """What a rig file says. reference_from_camera: (4, 4) by the camera's name. covariance: (6, 6) by name.

    camera_files, topics: by name, as written, the files relative to the rig file; empty where none was named.
    overlaps: names of two cameras that see the target together.
    """

    reference: str
    reference_from_camera: dict[str, np.ndarray]
    covariance: dict[str, np.ndarray]
    camera_files: dict[str, str]
    topics: dict[str, str] = field(default_factory=dict[str, str])
    overlaps: tuple[tuple[str, ...], ...] = ()


def rig_files(
    rig: RigCalibration,
    camera_files: Mapping[str, str],
    stand_ins: Sequence[FisheyeCamera],
    topics: Mapping[str, str],
) -> dict[str, str]:
    """What to write of a rig: the rig's file and Kalibr's, by the names that they have in a folder.

    camera_files, topics: by camera name, what is known of them. stand_ins: the cameras for Kalibr's file.
    """
    return {RIG: rig_yaml(rig, camera_files, topics), CAMCHAIN: kalibr_camchain(rig, stand_ins, topics)}


def rig_yaml(rig: RigCalibration, camera_files: Mapping[str, str], topics: Mapping[str, str]) -> str:
    """The rig file as text. camera_files, topics: by camera name, what is known of them."""
    facts = rig.to_dict()
    cameras = {
        name: {
            "camera_file": str(camera_files.get(name, "")),
            "topic": str(topics.get(name, "")),
            "position": camera["position_m"],
            "quaternion_xyzw": camera["quaternion_xyzw"],
            "reference_from_camera": camera["reference_from_camera"],
            "position_sigma": camera["position_sigma_m"],
            "rotation_sigma": camera["rotation_sigma_rad"],
            "covariance": rig.covariance[number].tolist(),
            "views": camera["views"],
            "rms_px": camera["rms_px"],
            "joined_through": camera["joined_through"],
        }
        for number, (name, camera) in enumerate(facts["cameras"].items())
    }
    content = {
        "schema": SCHEMA,
        "reference": facts["reference"],
        "cameras": cameras,
        "overlaps": facts["overlaps"],
        "calibration": {
            "rms_px": facts["rms_px"],
            "moments": facts["moments"],
            "board_warp": facts["board_warp_m"],
            "converged": facts["converged"],
            "date": datetime.datetime.now(datetime.timezone.utc).isoformat(timespec="seconds"),
        },
    }
    return yaml.safe_dump(content, sort_keys=False, default_flow_style=None, allow_unicode=True, width=1 << 16)


def places_yaml(reference_from_camera: Mapping[str, np.ndarray]) -> str:
    """A rig file that holds places (4, 4), metres, known exactly; the first camera is the reference."""
    content = {
        "schema": SCHEMA,
        "reference": next(iter(reference_from_camera)),
        "cameras": {
            name: {"reference_from_camera": place.tolist(), "covariance": np.zeros((6, 6)).tolist()}
            for name, place in reference_from_camera.items()
        },
    }
    return yaml.safe_dump(content, sort_keys=False, default_flow_style=None, width=1 << 16)


def kalibr_camchain(rig: RigCalibration, stand_ins: Sequence[FisheyeCamera], topics: Mapping[str, str]) -> str:
    """The rig in Kalibr's layout, its cameras those of the stand-ins."""
    overlapping: dict[int, list[int]] = {number: [] for number in range(len(rig.names))}
    for pair in rig.pairs:
        overlapping[pair.a].append(pair.b)
        overlapping[pair.b].append(pair.a)
    cameras = [
        PlacedCamera(
            name,
            stand_ins[number],
            reference_from_camera=rig.reference_from_camera[number],
            topic=str(topics.get(name, "")),
            overlaps=tuple(overlapping[number]),
        )
        for number, name in enumerate(rig.names)
    ]
    return camchain(cameras, stand_ins)


def load_rig(path: str | PathLike[str]) -> RigFile:
    """Read a rig file. Raises InputError."""
    path = checked_path(path, "path")
    content = read_yaml(path, "rig")
    try:
        return _parsed(content)
    except InputError as error:
        raise InputError(f"{one_line(path)} is not a rig file: {error}") from None


def _parsed(content: Any) -> RigFile:
    content = mapping(content, "a rig file")
    if needed(content, "schema") != SCHEMA:
        raise InputError(f"schema {shown(content['schema'])} is not known here; known: {SCHEMA}")
    given = mapping(needed(content, "cameras"), "cameras")
    cameras = {one_line(name, _LONGEST_NAME): mapping(block, f"cameras: {name}") for name, block in given.items()}
    if not cameras:
        raise InputError("cameras has none: name at least one")
    for name in cameras:
        if "/" in name or len(name.encode()) > _LONGEST_NAME:
            raise InputError(f"camera {shown(name)}: names of files are made of it: {_LONGEST_NAME} bytes, and no /")
    return RigFile(
        one_line(needed(content, "reference"), _LONGEST_NAME),
        {name: _pose(needed(block, "reference_from_camera"), name) for name, block in cameras.items()},
        {name: _covariance(needed(block, "covariance"), name) for name, block in cameras.items()},
        {name: str(block.get("camera_file", "")) for name, block in cameras.items()},
        {name: str(block.get("topic", "")) for name, block in cameras.items()},
        _overlaps(content.get("overlaps", [])),
    )


def _overlaps(content: Any) -> tuple[tuple[str, ...], ...]:
    pairs = [pair.get("cameras") if isinstance(pair, dict) else None for pair in _listed(content)]
    return tuple(tuple(map(str, _listed(pair))) for pair in pairs)


def _listed(content: Any) -> list[Any]:
    if not isinstance(content, list):
        raise InputError(f"overlaps must be a list, each with a list of cameras, not {shown(content)}")
    return content


def _covariance(rows: Any, camera: str) -> np.ndarray:
    covariance = matrix(rows, f"{camera}: covariance", 6, 6)
    if not (np.abs(covariance) <= _FARTHEST**2).all():
        raise InputError(f"{camera}: covariance must be finite")
    return covariance


def _pose(rows: Any, camera: str) -> np.ndarray:
    pose = matrix(rows, f"{camera}: reference_from_camera", 4, 4)
    if not ((np.abs(pose) <= _FARTHEST).all() and _is_turn(pose[:3, :3]) and np.array_equal(pose[3], [0, 0, 0, 1])):
        raise InputError(f"{camera}: reference_from_camera is not a rigid transform")
    return pose


def _is_turn(rotation: np.ndarray) -> bool:
    return bool(np.abs(rotation @ rotation.T - np.eye(3)).max() < _NOT_RIGID and np.linalg.det(rotation) > 0)


def is_rig_file(path: Path) -> bool:
    """Whether a file is a rig's by its content. False where it cannot be read: who reads it next says why."""
    try:
        content = read_yaml(path, "rig")
    except InputError:
        return False
    return isinstance(content, dict) and {"schema", "reference", "cameras"} <= set(content)
