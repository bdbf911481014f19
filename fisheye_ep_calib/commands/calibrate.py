"""fisheye_ep_calib calibrate: cameras from recordings or observation files."""

from __future__ import annotations

import argparse
import sys
from pathlib import Path
from typing import Any

from fisheye_ep_calib.calibration import Observations
from fisheye_ep_calib.calibration.options import AUTO, BOARD_SHAPES, DISC_CENTERS, LOSSES, PRINTED_FORM
from fisheye_ep_calib.calibration.structure import LENS
from fisheye_ep_calib.camera import LENS_EXTRAS, LENSES, PUPIL_FAMILIES
from fisheye_ep_calib.collection.progress import OnProgress
from fisheye_ep_calib.commands.messages import with_options
from fisheye_ep_calib.commands.reporting import CalibrationReports, refuse_unwritable
from fisheye_ep_calib.commands.sources import add_resume_argument, add_source_arguments, cameras_given
from fisheye_ep_calib.commands.summary import calibration_text
from fisheye_ep_calib.errors import CalibrationError, InputError
from fisheye_ep_calib.pipeline import CalibratedCamera, CameraSource, calibrate_cameras
from fisheye_ep_calib.pipeline.calibrating import none_calibrated
from fisheye_ep_calib.pipeline.found_so_far import log_of
from fisheye_ep_calib.pipeline.looking import LookAgain
from fisheye_ep_calib.pipeline.options import PASSES, check_fit, fit_options
from fisheye_ep_calib.pipeline.previous_camera import found_before, previous_file
from fisheye_ep_calib.pipeline.writing import (
    PAGE,
    RECORD,
    files_of,
    observation_file,
    refuse_existing,
    write_camera,
    write_observations,
)
from fisheye_ep_calib.storage.camera_file import read_camera_file
from fisheye_ep_calib.storage.json_text import json_text, read_json
from fisheye_ep_calib.storage.results_folder import results_folder

DESCRIPTION = (
    "Calibrate one or several cameras and write a camera file for each, CALIBRATION/NAME.yaml, and what was seen,\n"
    "CALIBRATION/observations/NAME.npz, from which the calibration can be repeated without the images;\n"
    "CALIBRATION/report.html shows it all to a person, CALIBRATION/calibration.json to a program."
)
EPILOG = """examples:
  fisheye_ep_calib calibrate recording.mcap --target board.yaml
  fisheye_ep_calib calibrate bag/ --target board.yaml --topic front=/front/image_raw --topic rear=/rear/image_raw
  fisheye_ep_calib calibrate calibration/observations/front.npz --model ep_even --board-warp --output again
"""
DEFAULT_OUTPUT = "calibration"


def add_arguments(parser: argparse.ArgumentParser) -> None:
    add_source_arguments(parser, many=True)
    parser.add_argument(
        "--output",
        type=Path,
        metavar="DIR",
        help=f"folder for the results (default: {DEFAULT_OUTPUT}, numbered where it is taken)",
    )
    parser.add_argument("--overwrite", action="store_true", help="replace earlier results in DIR")
    parser.add_argument(
        "--previous",
        type=Path,
        metavar="FILE",
        help="an earlier camera file, or a folder of them: what has changed since is told (default: the camera of the "
        "same name in DIR, or in the calibration before)",
    )
    add_resume_argument(parser)
    parser.add_argument("--json", action="store_true", help="print one JSON object on stdout")
    add_fit_arguments(parser)


def add_fit_arguments(parser: argparse.ArgumentParser) -> None:
    """What is made of the points found, and how."""
    parser.add_argument(
        "--model",
        default=AUTO,
        choices=[AUTO, *PUPIL_FAMILIES, PRINTED_FORM],
        help=f"{AUTO} fits all and takes what the data support (default); kannala has a single viewpoint; "
        f"{PRINTED_FORM}, the paper's equation as printed, is no camera",
    )
    parser.add_argument("--no-report", action="store_true", help="write no report.html")
    parser.add_argument(
        "--passes", type=int, choices=PASSES, default=2, help="2 looks again where the first fit expects the target"
    )
    structure = parser.add_argument_group("what is estimated", "With --model auto the data decide what you leave open.")
    structure.add_argument("--terms", type=int, metavar="N", help="terms of the entrance pupil's series")
    structure.add_argument("--lens", choices=list(LENSES), help=f"the central lens r(θ) (default: {LENS})")
    action = argparse.BooleanOptionalAction
    structure.add_argument("--skew", action=action, help="skew of the pixel axes")
    for name, extra in LENS_EXTRAS.items():
        structure.add_argument(f"--{name.replace('_', '-')}", action=action, help=extra.summary)
    structure.add_argument(
        "--board-shape",
        metavar="SHAPE",
        help=f"of the target, {'|'.join(BOARD_SHAPES)}|FILE: flat as its file has it; bow, three terms; free, by as "
        "much as the data say; auto, free where other views are predicted better with it (default with --model auto, "
        "else flat); or a target or camera file with a shape that was measured before",
    )
    structure.add_argument(
        "--flex", action="store_true", help="a board that bends and stretches from view to view is estimated"
    )
    structure.add_argument(
        "--rolling-shutter", action="store_true", help="a motion while the shutter rolls is estimated in every view"
    )
    structure.add_argument("--board-warp", action=action, help="the same as --board-shape bow")
    structure.add_argument(
        "--disc-centers",
        default="unbiased",
        choices=DISC_CENTERS,
        help="naive takes a projected disc's centre of gravity for the image of its centre, to compare",
    )
    structure.add_argument(
        "--loss",
        default="cut",
        choices=LOSSES,
        help="cut leaves out points beyond 6 σ of the richest model (default); huber gives them less weight",
    )
    structure.add_argument(
        "--force",
        action="store_true",
        help="write a camera that is refused for what its views leave open, and mark it as refused",
    )
    structure.add_argument(
        "--svp-distance",
        type=float,
        default=float("inf"),
        metavar="METRES",
        help="distance at which the single-viewpoint camera of CameraInfo is best (default: infinity)",
    )


def check_fit_arguments(arguments: argparse.Namespace) -> None:
    """Raises InputError before anything is looked at."""
    check_fit(arguments.model, arguments.passes, _options(arguments))


def run(arguments: argparse.Namespace) -> int:
    check_fit_arguments(arguments)
    if arguments.previous is not None and not arguments.previous.is_dir():
        read_camera_file(arguments.previous)  # before the images are looked at
    output = _free_folder(arguments.output)
    _refuse_taken(output, [], arguments)
    log = log_of(output, arguments.resume)
    earlier = _earlier_results(output)
    texts: list[str] = []
    with cameras_given(arguments, log, lambda names: _refuse_taken(output, names, arguments)) as given:
        with results_folder(output) as folder:
            reports, failures = _calibrate_all(given, arguments, folder, output, texts)
            written = {path.relative_to(folder) for path in folder.rglob("*")}
    # Only now: nobody may be reading, and the results are to be there all the same.
    text_stream = sys.stderr if arguments.json else sys.stdout
    for text in texts:
        print(text, file=text_stream)
    for path in sorted(earlier - written):
        print(f"note: {output / path} is of an earlier calibration", file=sys.stderr)
    for name, report in reports.items():
        print(
            f"{name}: wrote {report['yaml']}" if report["yaml"] else f"{name}: this model is no camera",
            file=text_stream,
        )
    if not arguments.no_report:
        print(f"wrote {output / PAGE}", file=text_stream)
    if arguments.json:
        print(json_text({"cameras": reports}))
    if len(given[0]) == 1 and failures:
        raise failures[0]
    return max((error.exit_code for error in failures), default=0)


def _calibrate_all(
    given: tuple[list[CameraSource], LookAgain | None, OnProgress],
    arguments: argparse.Namespace,
    folder: Path,
    output: Path,
    texts: list[str],
) -> tuple[dict[str, dict[str, Any]], list[CalibrationError]]:
    """Write every camera's results to ``folder``, which becomes ``output``; what ``--json`` says, and what failed.

    given: what ``cameras_given`` gives. texts: is given what to tell the user of each camera. Raises CalibrationError
    where no camera could be calibrated.
    """
    cameras, look_again, on_progress = given
    reports, failures = {}, []
    options = _options(arguments)
    with CalibrationReports(folder, cameras, arguments) as collected:
        done = calibrate_cameras(cameras, look_again, arguments.model, arguments.passes, on_progress, options)
        for camera, end in done:
            if isinstance(end, CalibratedCamera):
                if (before := _previous_camera(camera.name, len(cameras) == 1, output, arguments)) is not None:
                    end = end.since(before)
                name = write_camera(folder, end, end.camera_source)
                reports[camera.name] = end.to_dict() | {"yaml": None if name is None else str(output / name)}
                collected.add(end, reports[camera.name])
                texts.append(calibration_text(camera, end))
                if end.converged:
                    continue
                end = CalibrationError(f"the fit did not converge; its best state is in {output / (name or '')}")
            failures.append(end)
            reason = with_options(str(end), arguments)
            collected.add_failure(camera.name, reason)
            if len(cameras) > 1:
                print(f"{camera.name}: error: {reason}", file=sys.stderr)
        if not reports:
            raise none_calibrated(failures)
        for camera in cameras:
            if camera.name not in reports and camera.run is not None and isinstance(camera.outcome, Observations):
                write_observations(folder, camera)
                print(f"{camera.name}: what was found is in {output / observation_file(camera.name)}", file=sys.stderr)
    return reports, failures


def _options(arguments: argparse.Namespace) -> dict[str, Any]:
    return {name: getattr(arguments, name) for name in fit_options()}


def _free_folder(given: Path | None) -> Path:
    """The folder given, or the first of calibration, calibration_2, … that is not there yet."""
    if given is not None:
        refuse_unwritable("--output", given)
        return given
    number = 1
    while _numbered(number).exists():
        number += 1
    return _numbered(number)


def _numbered(number: int) -> Path:
    return Path(DEFAULT_OUTPUT if number == 1 else f"{DEFAULT_OUTPUT}_{number}")


def _previous_camera(name: str, alone: bool, output: Path, arguments: argparse.Namespace) -> Path | None:
    """The camera file that this calibration comes after; None where there is none."""
    if arguments.previous is not None:
        return previous_file(arguments.previous, name, alone)
    if arguments.output is not None:
        return found_before(output, name)
    number = 1
    while _numbered(number) != output:
        number += 1
    earlier = (found_before(_numbered(before), name) for before in range(number - 1, 0, -1))
    return next((path for path in earlier if path is not None), None)


def _refuse_taken(output: Path, names: list[str], arguments: argparse.Namespace) -> None:
    """Before hours of images are looked at. names: of cameras, as far as they are known."""
    pages = [] if arguments.no_report else [PAGE]
    of_cameras = [file for name in names for file in files_of(name)]
    refuse_existing([output / file for file in (*pages, RECORD, *of_cameras)], arguments.overwrite)
    given = [Path(source).absolute() for source in arguments.source]
    if arguments.split is not None and any((output / file).absolute() in given for file in of_cameras):
        raise InputError(f"--split {arguments.split} would lose its source's other images; give another --output")


def _earlier_results(output: Path) -> set[Path]:
    """What an earlier calibration has left in the folder, as far as its record tells; relative paths."""
    try:
        names = read_json(output / RECORD)["cameras"]
        files = [PAGE, *(f"{name}.yaml" for name in names)]
    except (InputError, KeyError, TypeError):
        return set()
    return {Path(file) for file in files if (output / file).exists()}
