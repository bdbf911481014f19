"""Calibrated cameras as files: camera files, observations and calibration.json."""

from __future__ import annotations

import os
from collections.abc import Mapping, Sequence
from os import PathLike
from pathlib import Path
from typing import Any

from fisheye_ep_calib.calibration import CalibrationResult
from fisheye_ep_calib.errors import InputError
from fisheye_ep_calib.outside import checked_path, other_than_a_file
from fisheye_ep_calib.pipeline.camera_source import CameraSource
from fisheye_ep_calib.storage.camera_file import save_camera
from fisheye_ep_calib.storage.observation_file import save_observations
from fisheye_ep_calib.storage.results_folder import results_folder
from fisheye_ep_calib.storage.target_file import save_target

PAGE, RECORD = "report.html", "calibration.json"


def refuse_existing(paths: Sequence[Path | None], overwrite: bool) -> None:
    """Nothing is replaced silently, and a pipe or a device not at all. Raises InputError."""
    for path in paths:
        if path is not None and (other := other_than_a_file(path)) and other != "a folder":  # one of overlays may be
            raise InputError(f"{path} is {other}, not a file; give another place")
        if path is not None and os.path.exists(path) and not overwrite:
            raise InputError(f"{path} is there already; give another place, or `overwrite`")


def files_of(name: str) -> tuple[str, ...]:
    """The files that a camera of that name may get, beside those of all cameras."""
    return f"{name}.yaml", f"{name}.not_converged.yaml", observation_file(name), board_file(name)


def observation_file(name: str) -> str:
    return f"observations/{name}.npz"


def board_file(name: str) -> str:
    return f"boards/{name}.yaml"


def write_observations(folder: Path, camera: CameraSource) -> None:
    save_observations(folder / observation_file(camera.name), camera.observations)


def write_camera(folder: Path, result: CalibrationResult, source: CameraSource) -> str | None:
    """Write the observations, then the camera file; one that did not converge is marked by its name.

    Returns the camera file's name; None for the paper's equation as printed, which is no camera.
    """
    write_observations(folder, source)
    if result.fit.structure.target_axis:
        return None
    name = f"{source.name}.yaml" if result.converged else f"{source.name}.not_converged.yaml"
    save_camera(folder / name, result, source.name, source.source)
    if source.target_keys and result.board.bends:
        save_target(folder / board_file(source.name), source.target_keys, result.board)
    return name


def record_of(result: CalibrationResult, source: CameraSource, content: Mapping[str, Any]) -> dict[str, Any]:
    """A camera's part of calibration.json. content: of ``CalibratedCamera.to_dict``."""
    from fisheye_ep_calib.report.from_calibration import calibration_views
    from fisheye_ep_calib.report.record import per_view

    views = calibration_views(source.observations, result)
    return {**content, "inputs": source.inputs(), "per_view": per_view(views)}


def write_cameras(
    folder: str | PathLike[str],
    results: Sequence[tuple[CalibrationResult, CameraSource, Mapping[str, Any]]],
    failed: Mapping[str, str] | None = None,
    *,
    overwrite: bool = False,
) -> dict[str, Path | None]:
    """Write all files of these cameras to a folder, all or none; returns camera name → camera file.

    results: each with what the camera saw, and the content of ``CalibratedCamera.to_dict``.
    """
    from fisheye_ep_calib.report.record import write_record

    output = checked_path(folder, "folder", "folder")
    taken = [output / file for _, source, _ in results for file in files_of(source.name)]
    refuse_existing([output / RECORD, *taken], overwrite)
    files: dict[str, Path | None] = {}
    records = {}
    with results_folder(output) as staging:
        for result, source, content in results:
            name = write_camera(staging, result, source)
            files[source.name] = None if name is None else output / name
            yaml = None if name is None else str(output / name)
            records[source.name] = record_of(result, source, {**content, "yaml": yaml})
        write_record(staging / RECORD, records, dict(failed or {}), {})
    return files
