"""A calibration held against an earlier one of the same camera."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from fisheye_ep_calib.calibration import CalibrationResult
from fisheye_ep_calib.calibration.assessing.camera_change import CameraChange, camera_change
from fisheye_ep_calib.errors import InputError
from fisheye_ep_calib.pipeline.known_camera import AnyCamera, known_camera
from fisheye_ep_calib.storage.camera_file import read_camera_file


def change_since(previous: AnyCamera, result: CalibrationResult) -> CameraChange:
    """How the camera differs from an earlier one, at the distance at which the target was seen in the middle of all.

    previous: a camera alone, a calibration, a camera file or its path. Raises InputError where it cannot be read.
    """
    file = known_camera(previous)
    poses = result.camera_from_target
    distance = float(np.median(np.linalg.norm(poses[:, :3, 3], axis=1)))
    name = str(previous) if isinstance(previous, str | Path) else file.name
    return camera_change(
        (file.camera, file.covariance if file.covariance.any() else None),
        (result.camera, result.uncertainty.covariance),
        distance,
        name,
    )


def previous_file(given: Path, name: str, alone: bool) -> Path | None:
    """The earlier camera file of a camera: the file given, or NAME.yaml in the folder given; None where there is none.

    alone: whether there is but one camera; else the file must be of the camera's name. Raises InputError where the
    file given cannot be read.
    """
    if given.is_dir():
        path = given / f"{name}.yaml"
        return path if path.is_file() else None
    file = read_camera_file(given)
    return given if alone or file.name == name else None


def found_before(folder: Path, name: str) -> Path | None:
    """An earlier camera file of that name in a results folder; None where there is none that can be read."""
    path = folder / f"{name}.yaml"
    try:
        read_camera_file(path)
    except InputError:
        return None
    return path
