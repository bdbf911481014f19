"""fisheye_ep_calib evaluate: a camera file measured on other images."""

from __future__ import annotations

import argparse
import sys
from pathlib import Path

from fisheye_ep_calib.calibration.assessing.evaluation import Evaluation, evaluate_camera
from fisheye_ep_calib.calibration.calibrate import DISC_CENTERS
from fisheye_ep_calib.commands.reporting import refuse_unusable_report, write_evaluation_report
from fisheye_ep_calib.commands.sources import add_source_arguments, cameras_given
from fisheye_ep_calib.errors import InputError
from fisheye_ep_calib.storage.camera_file import read_camera_file
from fisheye_ep_calib.storage.json_text import json_text

DESCRIPTION = "Measure a camera file on a recording: every view's pose is refitted, the camera stays as it is."
EPILOG = """example:
  fisheye_ep_calib evaluate calibration/front.yaml other_recording.mcap --target board.yaml
"""


def add_arguments(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("camera", type=Path, metavar="CAMERA.yaml")
    add_source_arguments(parser, many=False)
    parser.add_argument("--board-warp", action="store_true", help="bend the target as the camera file says it is bent")
    parser.add_argument("--disc-centers", default="unbiased", choices=DISC_CENTERS, help=argparse.SUPPRESS)
    parser.add_argument("--report", type=Path, metavar="FILE.html", help="write a page with figures too")
    parser.add_argument("--overwrite", action="store_true", help="replace an earlier report")
    parser.add_argument("--json", action="store_true", help="print one JSON object on stdout")


def run(arguments: argparse.Namespace) -> int:
    refuse_unusable_report(arguments)
    file = read_camera_file(arguments.camera)
    with cameras_given(arguments, before_looking=_refuse_several) as (cameras, _):
        observations = cameras[0].observations
        warp = file.board_warp if arguments.board_warp else None
        found = evaluate_camera(file.camera, observations, warp, arguments.disc_centers)
        if arguments.report is not None:
            write_evaluation_report(cameras[0], file, found, arguments)
    names = observations.image_names
    failed = {names[image]: reason for image, reason in found.failed.items()}
    for name, reason in failed.items():
        print(f"{name}: {reason}", file=sys.stderr)
    if arguments.json:
        print(json_text(_json(found, failed)))
        return 0
    print(f"{len(found.images)} views, {found.points} points; {len(failed)} views without a pose")
    print(f"RMS {found.rms_px:.4f} px, median {found.median_px:.4f} px, 95 % below {found.p95_px:.4f} px")
    return 0


def _refuse_several(names: list[str]) -> None:
    if len(names) != 1:
        raise InputError("one camera at a time: give one --topic")


def _json(found: Evaluation, failed: dict[str, str]) -> dict:
    return {
        "rms_px": found.rms_px,
        "median_px": found.median_px,
        "p95_px": found.p95_px,
        "views": len(found.images),
        "points": found.points,
        "failed_views": list(failed),
    }
