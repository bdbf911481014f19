"""fisheye_ep_calib compare: how two calibrations of a camera differ in pixels."""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import Any

import numpy as np

from fisheye_ep_calib.calibration.assessing.camera_difference import ALIGNMENTS
from fisheye_ep_calib.calibration.comparison import (
    DistanceSummary,
    agreement,
    alignment_text,
    by_ring,
    summaries,
)
from fisheye_ep_calib.calibration.words import distance_text
from fisheye_ep_calib.commands.reporting import refuse_unusable_report
from fisheye_ep_calib.errors import InputError
from fisheye_ep_calib.pipeline.compared_cameras import DISTANCES, ComparedCameras, compare
from fisheye_ep_calib.report.comparison import write_comparison
from fisheye_ep_calib.report.data import ModelCurve
from fisheye_ep_calib.report.models import angles, pupil_curve
from fisheye_ep_calib.report.record import now, versions
from fisheye_ep_calib.storage.camera_file import read_camera_file
from fisheye_ep_calib.storage.camera_file_parsing import CameraFile
from fisheye_ep_calib.storage.json_text import json_text

DESCRIPTION = (
    "Compare two camera files: the points that A sees in its pixels are projected by B, at several distances, after B\n"
    "was turned to agree best, and the difference is set against what the uncertainties of both lead to expect.\n"
    "The calibrations are taken as independent of each other."
)
EPILOG = """example:
  fisheye_ep_calib compare monday/front.yaml tuesday/front.yaml --distance 0.1 1 inf --report difference.html
"""


def add_arguments(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("first", type=Path, metavar="A.yaml")
    parser.add_argument("second", type=Path, metavar="B.yaml")
    parser.add_argument(
        "--distance",
        type=float,
        nargs="+",
        default=list(DISTANCES),
        metavar="METRES",
        help="distances of the points from A's origin, inf too (default: 0.1 0.3 1 10 inf)",
    )
    parser.add_argument(
        "--align",
        choices=ALIGNMENTS,
        default="rotation",
        help="what is no property of a camera: its orientation (default); rigid adds the origin of its frame, which "
        "extrinsics made with the same file take up",
    )
    parser.add_argument("--report", type=Path, metavar="FILE.html", help="write a page with figures too")
    parser.add_argument("--overwrite", action="store_true", help="replace an earlier report")
    parser.add_argument("--json", action="store_true", help="print one JSON object on stdout")


def run(arguments: argparse.Namespace) -> int:
    if any(not distance > 0 for distance in arguments.distance):
        raise InputError("--distance takes positive lengths in metres, or inf")
    refuse_unusable_report(arguments)
    files = read_camera_file(arguments.first), read_camera_file(arguments.second)
    try:
        comparison = compare(files[0], files[1], arguments.distance, alignment=arguments.align)
    except InputError as error:
        raise InputError(f"{arguments.first} and {arguments.second}: {error}") from None
    rows = summaries(comparison)
    if arguments.report is not None:
        names = files[0].name, files[1].name
        size, inputs = files[0].camera.image_size, _inputs(arguments) | {"boards": comparison.boards.sentence}
        write_comparison(arguments.report, names, comparison, arguments.align, _curves(files), size, inputs)
    if arguments.json:
        print(json_text(_json(arguments, comparison)))
        return 0
    print(_text(arguments, files, comparison, rows))
    return 0


def _curves(files: tuple[CameraFile, CameraFile]) -> tuple[ModelCurve, ModelCurve]:
    first, second = (
        pupil_curve(f"{label}: {file.camera.model}", file.camera, file.covariance, angles(file.camera), False)
        for label, file in zip("AB", files, strict=True)
    )
    return first, second


def _inputs(arguments: argparse.Namespace) -> dict[str, str]:
    return {"A": str(arguments.first), "B": str(arguments.second), "written": now(), **versions()}


def _text(
    arguments: argparse.Namespace,
    files: tuple[CameraFile, CameraFile],
    comparison: ComparedCameras,
    rows: tuple[DistanceSummary, ...],
) -> str:
    lines = [
        f"A {arguments.first}, B {arguments.second}: B minus A over the field up to "
        f"{np.degrees(comparison.theta.max()):.0f}°",
        *(f"{label} is read as {file.origin}" for label, file in zip("AB", files, strict=True) if file.origin),
        alignment_text(comparison, arguments.align),
        f"  {'distance':>10}{'RMS px':>10}{'median':>9}{'95 %':>9}{'largest':>9}{'expected':>10}",
    ]
    for row in rows:
        mark = "  !" if row.beyond_noise and any(comparison.covariances_given) else ""
        lines.append(
            f"  {distance_text(row.distance_m):>10}{row.rms_px:>10.4f}{row.median_px:>9.4f}{row.p95_px:>9.4f}"
            f"{row.largest_px:>9.4f}{_expected(comparison, row.expected_px):>10}{mark}"
        )
    theta, difference, expected = by_ring(comparison)
    lines.append("  RMS px (expected) by angle:")
    lines.append(f"  {'θ':>5} " + "".join(f"{distance_text(value):>18}" for value in comparison.distance_m))
    for ring, degrees in enumerate(theta):
        pairs = zip(difference[:, ring], expected[:, ring], strict=True)
        cells = (f"{value:.3f} ({_expected(comparison, noise)})" for value, noise in pairs)
        lines.append(f"  {degrees:>4.0f}° " + "".join(f"{cell:>18}" for cell in cells))
    lines += [comparison.boards.sentence, agreement(comparison, rows)[1]]
    if arguments.report is not None:
        lines.append(f"wrote {arguments.report}")
    return "\n".join(lines)


def _expected(comparison: ComparedCameras, value: float) -> str:
    return f"{value:.3f}" if any(comparison.covariances_given) else "–"


def _json(arguments: argparse.Namespace, comparison: ComparedCameras) -> dict[str, Any]:
    return {
        "first": str(arguments.first),
        "second": str(arguments.second),
        **comparison.to_dict(),
        "report": None if arguments.report is None else str(arguments.report),
    }
