"""fisheye_ep_calib rectify: images of a recording without the fisheye's distortion."""

from __future__ import annotations

import argparse
import math
import re
import sys
from collections.abc import Sequence
from pathlib import Path

import cv2
import yaml

from fisheye_ep_calib.camera.camera_info import camera_info_content
from fisheye_ep_calib.collection.progress import progress_bar
from fisheye_ep_calib.errors import CalibrationError, InputError
from fisheye_ep_calib.pipeline.names import image_stem, numbered_alike
from fisheye_ep_calib.pipeline.writing import refuse_existing
from fisheye_ep_calib.rectification import (
    INTERPOLATIONS,
    PROJECTIONS,
    SURFACES,
    Rectifier,
    make_view,
    rectified_camera_info,
)
from fisheye_ep_calib.storage.atomic import atomic_write
from fisheye_ep_calib.storage.camera_file import read_camera_file
from fisheye_ep_calib.storage.camera_file_parsing import CameraFile
from fisheye_ep_calib.storage.recording import Frame, Recording, choose_topics, open_recording
from fisheye_ep_calib.storage.results_folder import results_folder

DESCRIPTION = (
    "Write the images of a recording as a camera with one viewpoint sees them. A fisheye has none: its pupil moves\n"
    "with the angle. So the result is right for points at one distance, and that matters the more the nearer they are."
)
EPILOG = """examples:
  fisheye_ep_calib rectify front.yaml recording.mcap --distance 0.12 --output rectified
  fisheye_ep_calib rectify front.yaml images/ --projection equirectangular --output around
  fisheye_ep_calib rectify front.yaml images/ --fov 70 --size 1280x720 --yaw 60 --output right
"""
CAMERA_INFO = "camera_info.yaml"


def add_arguments(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("camera", type=Path, metavar="CAMERA.yaml")
    parser.add_argument("source", metavar="SOURCE", help="a bag, a folder of images, or one image")
    parser.add_argument("--output", type=Path, required=True, metavar="DIR", help="folder for the images, as PNG")
    parser.add_argument("--overwrite", action="store_true", help="replace earlier images in DIR")
    parser.add_argument("--topic", metavar="TOPIC", help="image topic, where the recording has several")
    parser.add_argument("--every", type=int, default=1, metavar="N", help="every N-th image (default: each)")
    parser.add_argument("--strict", action="store_true", help="refuse damaged recordings and images")
    scene = parser.add_argument_group("what is right")
    scene.add_argument(
        "--distance",
        type=float,
        default=math.inf,
        metavar="METRES",
        help="of the scene, measured from the lens (default: infinity)",
    )
    scene.add_argument(
        "--surface",
        choices=SURFACES,
        help="at that distance: a plane across the view's axis (default of a perspective view) or a sphere",
    )
    scene.add_argument(
        "--svp", action="store_true", help="with the single-viewpoint camera of CameraInfo instead, to compare"
    )
    view = parser.add_argument_group("the rectified image")
    view.add_argument("--projection", choices=list(PROJECTIONS), default="perspective")
    view.add_argument(
        "--fov",
        type=float,
        metavar="DEGREES",
        help="horizontal field of view (default: the camera's, 100 at most for a perspective view)",
    )
    view.add_argument("--size", type=image_size, metavar="WxH", help="pixels (default: keeps the resolution)")
    view.add_argument("--yaw", type=float, default=0.0, metavar="DEGREES", help="look to the right (default: 0)")
    view.add_argument("--pitch", type=float, default=0.0, metavar="DEGREES", help="look up (default: 0)")
    view.add_argument("--interpolation", choices=list(INTERPOLATIONS), default="cubic")


def image_size(text: str) -> tuple[int, int]:
    """ "1280x720" as (1280, 720)."""
    if not re.fullmatch(r"\d{1,6}[x×]\d{1,6}", text):
        raise argparse.ArgumentTypeError(f"{text!r} is not WIDTHxHEIGHT, such as 1280x720")
    width, height = re.split("[x×]", text)
    return int(width), int(height)


def run(arguments: argparse.Namespace) -> int:
    if not arguments.distance > 0:
        raise InputError("--distance must be positive")
    if arguments.every < 1:
        raise InputError("--every must be at least 1")
    file = read_camera_file(arguments.camera)
    camera = file.stand_in if arguments.svp else file.camera
    fov = None if arguments.fov is None else math.radians(arguments.fov)
    view = make_view(
        camera, arguments.projection, fov, arguments.size, math.radians(arguments.yaw), math.radians(arguments.pitch)
    )
    rectifier = Rectifier(camera, view, arguments.surface, arguments.interpolation)
    with open_recording(arguments.source, strict=arguments.strict) as recording:
        for problem in recording.problems:
            print(f"warning: {problem}", file=sys.stderr)
        frames = _frames(recording, arguments)
        names = [f"{name}.png" for name in numbered_alike(image_stem(frame.name) for frame in frames)]
        refuse_existing([arguments.output / name for name in (*names, CAMERA_INFO)], arguments.overwrite)
        with results_folder(arguments.output) as folder:
            written = _rectify(frames, [folder / name for name in names], rectifier, arguments)
            atomic_write(folder / CAMERA_INFO, _description(rectifier, file, arguments).encode())
    count = f"{written} image{'s' if written != 1 else ''}"
    print(f"wrote {count}, {view.size[0]}×{view.size[1]}, and {CAMERA_INFO} to {arguments.output}")
    return 0


def _frames(recording: Recording, arguments: argparse.Namespace) -> list[Frame]:
    (topic,) = choose_topics(recording, (arguments.topic,) if arguments.topic else ())
    return [recording.frame(topic, index) for index in range(0, recording.count(topic), arguments.every)]


def _rectify(
    frames: Sequence[Frame], paths: Sequence[Path], rectifier: Rectifier, arguments: argparse.Namespace
) -> int:
    """How many images were written; damaged ones are told and passed over."""
    written, first_error = 0, ""
    progress = progress_bar(zip(frames, paths, strict=True), "rectifying", total=len(frames))
    for frame, path in progress:
        try:
            picture = rectifier.rectify(frame.picture().for_opencv(), arguments.distance)
        except InputError as error:
            if arguments.strict:
                raise InputError(f"{frame.name}: {error}") from None
            first_error = first_error or f"{frame.name}: {error}"
            print(f"warning: {frame.name}: {error}", file=sys.stderr)
            continue
        encoded, content = cv2.imencode(".png", picture)
        if not encoded:
            raise CalibrationError(f"{frame.name} cannot be written as PNG")
        atomic_write(path, content.tobytes())
        written += 1
    if not written:
        raise InputError(f"none of {len(frames)} images could be rectified: {first_error}")
    return written


def _description(rectifier: Rectifier, file: CameraFile, arguments: argparse.Namespace) -> str:
    """What camera_info_manager reads, and the block ``view`` for what no CameraInfo can say."""
    view = rectifier.view
    content = camera_info_content(rectified_camera_info(view), f"{file.name}_rectified")
    content["view"] = {
        "projection": view.projection,
        "focal_px": float(view.focal),
        "centre_px": [float(value) for value in view.centre],
        "yaw_deg": float(arguments.yaw),
        "pitch_deg": float(arguments.pitch),
        "surface": rectifier.surface,
        "distance": float(arguments.distance),
        "camera": "single viewpoint" if arguments.svp else rectifier.camera.model,
    }
    return yaml.safe_dump(content, sort_keys=False, default_flow_style=None, allow_unicode=True, width=1 << 16)
