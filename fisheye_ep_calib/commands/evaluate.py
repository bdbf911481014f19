"""fisheye_ep_calib evaluate: a camera file measured on other images."""

from __future__ import annotations

import argparse
import sys
from functools import partial
from pathlib import Path

from fisheye_ep_calib.calibration.options import DISC_CENTERS
from fisheye_ep_calib.calibration.words import BAD
from fisheye_ep_calib.commands.messages import with_options
from fisheye_ep_calib.commands.reporting import refuse_unusable_report, write_evaluation_report
from fisheye_ep_calib.commands.sources import add_source_arguments, cameras_given
from fisheye_ep_calib.errors import CalibrationError, InputError
from fisheye_ep_calib.pipeline import evaluate
from fisheye_ep_calib.storage.camera_file import read_camera_file
from fisheye_ep_calib.storage.json_text import json_text

DESCRIPTION = (
    "Measure a camera file on a recording: every view's pose is refitted, the camera stays as it is. The exit code\n"
    "is 1 where the camera is plainly wrong."
)
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
    name = read_camera_file(arguments.camera).name  # before the images are looked at
    with cameras_given(arguments, before_looking=partial(_refuse_several, name), camera=name) as (cameras, _, _):
        judged = evaluate(
            arguments.camera, cameras[0], board_warp=arguments.board_warp, disc_centers=arguments.disc_centers
        )
        if arguments.report is not None:
            write_evaluation_report(judged, arguments)
    names = judged.observations.image_names
    for image, reason in judged.failed.items():
        print(f"{names[image]}: {reason}", file=sys.stderr)
    code = CalibrationError.exit_code if judged.verdict.level == BAD else 0
    if arguments.json:
        print(json_text(judged.to_dict()))
        return code
    print(f"{len(judged.images)} views, {judged.points} points; {len(judged.failed)} views without a pose")
    expected = judged.expected_rms_px
    print(
        f"RMS {judged.rms_px:.4f} px{'' if expected is None else f' ({expected:.4f} px expected)'}, "
        f"median {judged.median_px:.4f} px, 95 % below {judged.p95_px:.4f} px"
    )
    print(with_options(judged.board_words, arguments))
    for finding in judged.findings:
        print(f"  {'!' if finding.concern else '·'} {finding.line}")
    print(judged.verdict.headline)
    return code


def _refuse_several(camera: str, names: list[str]) -> None:
    if len(names) != 1:
        raise InputError(f"here are {', '.join(names)}, and the file's camera is called {camera}: give one --topic")
