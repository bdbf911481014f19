"""Reports beside the results of the commands calibrate and evaluate."""

from __future__ import annotations

import argparse
import os
import sys
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from fisheye_ep_calib.errors import CalibrationError, InputError, Interrupted
from fisheye_ep_calib.pipeline import CalibratedCamera, CameraSource, EvaluatedCamera
from fisheye_ep_calib.pipeline.writing import PAGE, RECORD, record_of, refuse_existing
from fisheye_ep_calib.report.data import CameraReport
from fisheye_ep_calib.report.record import write_record
from fisheye_ep_calib.storage.results_folder import nearest_folder


def refuse_unwritable(option: str, folder: Path) -> None:
    """Raises InputError where nothing can be written to the folder, or to the nearest above it that is there."""
    there = nearest_folder(folder)
    if not there.is_dir():
        raise InputError(f"{option} {folder}: {there} is not a folder")
    if not os.access(there, os.W_OK | os.X_OK):
        raise InputError(f"{option} {folder}: no permission to write in {there}")


def refuse_unusable_report(arguments: argparse.Namespace) -> None:
    """Raises InputError where the page of ``--report`` could not be written, or would replace another."""
    report = arguments.report
    if report is None:
        return
    refuse_existing([report], arguments.overwrite)
    if report.is_dir():
        raise InputError(f"--report {report} is a folder; give a file in it")
    refuse_unwritable("--report", report.parent)


class CalibrationReports:
    """Collects the cameras of one ``calibrate`` and writes report.html and calibration.json to ``folder`` when left.

    What was collected is written after a CalibrationError too: the other cameras' results are there.
    """

    def __init__(self, folder: Path, cameras: Sequence[CameraSource], arguments: argparse.Namespace) -> None:
        self._folder, self._cameras, self._arguments = folder, cameras, arguments
        self._pages: list[CameraReport] = []
        self._records: dict[str, dict[str, Any]] = {}
        self._failed: dict[str, str] = {}

    def __enter__(self) -> CalibrationReports:
        return self

    def add(self, result: CalibratedCamera, content: dict[str, Any]) -> None:
        """content: what ``--json`` says of the camera. Its images are read now, while they are open."""
        self._records[result.name] = record_of(result, result.camera_source, content)
        if not self._arguments.no_report:
            self._pages.append(result.page(pictures=True, share=len(self._cameras)))

    def add_failure(self, name: str, reason: str) -> None:
        self._failed[name] = reason

    def __exit__(self, kind: object, error: BaseException | None, _: object) -> None:
        unfinished = error is not None and (isinstance(error, Interrupted) or not isinstance(error, CalibrationError))
        if not self._records or unfinished:
            return
        write_record(self._folder / RECORD, self._records, self._failed, _options(self._arguments))
        if self._arguments.no_report:
            return
        from fisheye_ep_calib.report.html import write_report

        write_report(self._folder / PAGE, self._pages)


def write_evaluation_report(judged: EvaluatedCamera, arguments: argparse.Namespace) -> None:
    """The page of ``evaluate --report``. The camera's images are read now, while they are open."""
    judged.report(arguments.report)
    print(f"wrote {arguments.report}", file=sys.stderr if arguments.json else sys.stdout)


def _options(arguments: argparse.Namespace) -> dict[str, Any]:
    """The command's options as they were understood."""
    given = {name: value for name, value in sorted(vars(arguments).items()) if name not in ("run", "command")}
    return {name: str(value) if isinstance(value, Path) else value for name, value in given.items()}
