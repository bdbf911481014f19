"""fisheye_ep_calib detect: find the target in images, and show what was found and what was not."""

from __future__ import annotations

import argparse
import sys
from collections.abc import Sequence
from pathlib import Path

import cv2
import numpy as np

from fisheye_ep_calib.collection.progress import progress_bar
from fisheye_ep_calib.collection.results import FrameResult
from fisheye_ep_calib.commands.sources import add_resume_argument, add_source_arguments, look_given
from fisheye_ep_calib.errors import CalibrationError, InputError
from fisheye_ep_calib.pipeline import CameraSource, Looking, looking
from fisheye_ep_calib.pipeline.found_so_far import log_of
from fisheye_ep_calib.pipeline.names import image_stem
from fisheye_ep_calib.pipeline.writing import refuse_existing
from fisheye_ep_calib.storage.atomic import atomic_write
from fisheye_ep_calib.storage.observation_file import save_observations
from fisheye_ep_calib.storage.results_folder import results_folder
from fisheye_ep_calib.target import Detection

DESCRIPTION = (
    "Find the target in images and write an observation file for each camera. With --overlay, also every image with\n"
    "the found points (green, with their ids) and the candidates that were refused (red)."
)
EPILOG = """example:
  fisheye_ep_calib detect recording.mcap --target board.yaml --output found --overlay
"""
_FOUND, _REFUSED, _TEXT = (60, 220, 60), (60, 60, 255), (255, 220, 120)  # blue, green, red


def add_arguments(parser: argparse.ArgumentParser) -> None:
    add_source_arguments(parser, many=True)
    parser.add_argument("--output", type=Path, required=True, metavar="DIR", help="folder for the results")
    parser.add_argument("--overlay", action="store_true", help="write the images with what was found in them")
    parser.add_argument("--overwrite", action="store_true", help="replace earlier results in DIR")
    add_resume_argument(parser)


def run(arguments: argparse.Namespace) -> int:
    for source in arguments.source:
        if Path(source).suffix == ".npz":
            raise InputError(f"{source}: detect needs images; an observation file holds what was found already")
    output, log = arguments.output, log_of(arguments.output, arguments.resume)
    with look_given(arguments, log) as look, looking(arguments.source, arguments.target, look) as place:
        refuse_existing(_results(output, list(place.topics), arguments.overlay), arguments.overwrite)
        cameras = place.first_look()
        with results_folder(output) as folder:
            ended = {camera.name: _write(place, camera, arguments, folder) for camera in cameras}
    failures = [end for end in ended.values() if isinstance(end, CalibrationError)]
    if len(ended) == len(failures) == 1:
        raise failures[0]
    for name, end in ended.items():
        if isinstance(end, CalibrationError):
            print(f"{name}: error: {end}", file=sys.stderr)
        else:
            print(end)
    return max((error.exit_code for error in failures), default=0)


def _results(output: Path, names: Sequence[str], overlay: bool) -> list[Path]:
    overlays = [output / f"{name}_overlay" for name in names] if overlay else []
    return [*(output / f"{name}.npz" for name in names), *overlays]


def _write(place: Looking, camera: CameraSource, arguments: argparse.Namespace, folder: Path) -> str | CalibrationError:
    """One camera's results; returns what to say of them, or why there are no observations."""
    name, run = camera.name, camera.run
    assert run is not None  # it was looked at
    for view, reason in camera.unused_views.items():
        print(f"{name}: {view}: {reason}")
    if arguments.overlay:
        _write_overlays(place, name, run.frames, folder / f"{name}_overlay")
    if isinstance(camera.outcome, CalibrationError):
        return camera.outcome
    save_observations(folder / f"{name}.npz", camera.outcome)
    points, views = len(camera.outcome.pixels), len(run.views)
    return f"{name}: {points} points in {views} views: {arguments.output / f'{name}.npz'}"


def _write_overlays(place: Looking, name: str, frames: Sequence[FrameResult], folder: Path) -> None:
    folder.mkdir(parents=True, exist_ok=True)
    for frame in progress_bar(frames, f"{name}: overlays"):
        if frame.error:
            continue
        image = place.recording.frame(frame.topic, frame.index).image()
        picture = overlay(image, frame.detection, frame.reason)
        _, content = cv2.imencode(".png", picture)
        atomic_write(folder / f"{frame.index:06d}_{image_stem(frame.name)}.png", content.tobytes())


def overlay(image: np.ndarray, detection: Detection, reason: str) -> np.ndarray:
    """A grey image (h, w) uint8 as (h, w, 3) with found points and ids, refused candidates, and the reason if any."""
    picture = cv2.cvtColor(image, cv2.COLOR_GRAY2BGR)
    size = max(0.35, max(image.shape) / 4000)
    for x, y in detection.rejected:
        cv2.drawMarker(
            picture, (round(x), round(y)), _REFUSED, cv2.MARKER_TILTED_CROSS, round(24 * size), 1, cv2.LINE_AA
        )
    for number, (x, y) in zip(detection.point_index, detection.pixels, strict=True):
        at = (round(x * 16), round(y * 16))
        cv2.circle(picture, at, round(16 * 12 * size), _FOUND, 1, cv2.LINE_AA, shift=4)
        cv2.circle(picture, at, 24, _FOUND, -1, cv2.LINE_AA, shift=4)
        cv2.putText(
            picture,
            str(number),
            (round(x + 10 * size), round(y - 6 * size)),
            cv2.FONT_HERSHEY_SIMPLEX,
            size,
            _TEXT,
            1,
            cv2.LINE_AA,
        )
    if reason:
        text = reason.encode("ascii", "replace").decode()
        cv2.putText(
            picture, text, (12, round(60 * size) + 12), cv2.FONT_HERSHEY_SIMPLEX, 2 * size, _REFUSED, 2, cv2.LINE_AA
        )
    return picture
