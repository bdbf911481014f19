"""fisheye_ep_calib rig: where calibrated cameras are to each other."""

from __future__ import annotations

import argparse
import math
import os
import sys
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path

import numpy as np

from fisheye_ep_calib.collection.progress import ProgressBars
from fisheye_ep_calib.commands.sources import add_resume_argument, add_worker_arguments, topics_given
from fisheye_ep_calib.errors import CalibrationError, InputError
from fisheye_ep_calib.pipeline import Look
from fisheye_ep_calib.pipeline.found_so_far import Log
from fisheye_ep_calib.pipeline.names import safe_name
from fisheye_ep_calib.pipeline.rig_looking import RigSource, rig_sources
from fisheye_ep_calib.pipeline.writing import refuse_existing
from fisheye_ep_calib.rig import USUAL_TOLERANCE, RigCalibration, RigCamera, calibrate_rig
from fisheye_ep_calib.storage.camera_file import read_camera_file
from fisheye_ep_calib.storage.camera_file_parsing import CameraFile
from fisheye_ep_calib.storage.json_text import json_text
from fisheye_ep_calib.storage.observation_file import save_observations
from fisheye_ep_calib.storage.results_folder import beside, results_folder
from fisheye_ep_calib.storage.rig_file import CAMCHAIN, RIG, rig_files

DESCRIPTION = (
    "Find where calibrated cameras are to each other, from views in which two or more of them see the target at the\n"
    "same time. Cameras that never see it together are joined by those between them. The first --camera is the\n"
    "reference. Writes DIR/rig.yaml, in Kalibr's layout DIR/camchain.yaml, and what was seen in images,\n"
    "DIR/rig_observations/NAME.npz, from which it can be repeated without them."
)
EPILOG = """examples:
  fisheye_ep_calib rig recording.mcap --target board.yaml --camera front=front.yaml --camera rear=rear.yaml
  fisheye_ep_calib rig observations/front.npz observations/rear.npz --camera front=front.yaml --camera rear=rear.yaml
"""
OBSERVATIONS = "rig_observations"


def add_arguments(parser: argparse.ArgumentParser) -> None:
    kinds = "bags or folders of images, or an observation file NAME.npz for each camera"
    parser.add_argument("source", nargs="+", metavar="SOURCE", help=kinds)
    parser.add_argument(
        "--camera",
        action="append",
        required=True,
        metavar="NAME=CAMERA.yaml",
        help="a camera of the rig; repeat for each, the reference first",
    )
    parser.add_argument("--target", type=Path, metavar="TARGET.yaml", help="the target; .npz files need none")
    parser.add_argument(
        "--topic", action="append", default=[], metavar="NAME=TOPIC", help="image topic (default: by its name)"
    )
    parser.add_argument(
        "--tolerance",
        type=float,
        default=USUAL_TOLERANCE,
        metavar="SECONDS",
        help=f"images within it are of the same time (default: {USUAL_TOLERANCE:g}); more where the target stood still",
    )
    parser.add_argument(
        "--time-offset",
        choices=("none", "auto"),
        default="none",
        help="auto: the cameras' clocks differ by constants, which are found by how the target moved (default: none)",
    )
    looking = parser.add_argument_group("which images to look at")
    looking.add_argument(
        "--max-moments", type=int, metavar="N", help="look at N times (default: 150, fewer if none shows the target)"
    )
    add_worker_arguments(looking)
    parser.add_argument("--board-warp", action="store_true", help="estimate the bow of the target too")
    parser.add_argument(
        "--unmistakable",
        action="store_true",
        help="the target cannot be taken for itself turned (known of ChArUco boards and AprilGrids in images)",
    )
    parser.add_argument(
        "--output", type=Path, default=Path("."), metavar="DIR", help="folder for the results (default: .)"
    )
    parser.add_argument("--overwrite", action="store_true", help="replace earlier results in DIR")
    add_resume_argument(parser)
    parser.add_argument("--json", action="store_true", help="print one JSON object on stdout")


def run(arguments: argparse.Namespace) -> int:
    if not 0 <= arguments.tolerance < math.inf:
        raise InputError("--tolerance must not be negative")
    if arguments.max_moments is not None and arguments.max_moments < 2:
        raise InputError("--max-moments must be at least 2")
    output, paths = arguments.output, _cameras(arguments.camera)
    names = (RIG, CAMCHAIN, *(f"{OBSERVATIONS}/{name}.npz" for name in paths))
    refuse_existing([output / name for name in names], arguments.overwrite)
    files = {name: read_camera_file(path) for name, path in paths.items()}
    cameras = {name: file.camera for name, file in files.items()}
    with _look(arguments) as look:
        given = rig_sources(
            arguments.source, arguments.target, cameras, look, arguments.tolerance, arguments.time_offset == "auto"
        )
        with given as sources:
            for name, source in sources.items():
                if source.topic:
                    save_observations(output / OBSERVATIONS / f"{name}.npz", source.observations)
    result = _calibrated(files, sources, arguments)
    topics = {name: source.topic for name, source in sources.items() if source.topic}
    beside_it = {name: os.path.relpath(path, output) for name, path in paths.items()}
    stand_ins = [file.stand_in for file in files.values()]
    with results_folder(output) as folder:
        for name, text in rig_files(result, beside_it, stand_ins, topics).items():
            (folder / name).write_text(text, encoding="utf-8")
    print(_text(result, output), file=sys.stderr if arguments.json else sys.stdout)
    if arguments.json:
        print(json_text({**result.to_dict(), "yaml": str(output / RIG), "camchain": str(output / CAMCHAIN)}))
    if not result.converged:
        raise CalibrationError(f"the fit did not converge; its best state is in {output / RIG}")
    return 0


@contextmanager
def _look(arguments: argparse.Namespace) -> Iterator[Look]:
    """How to look, by the arguments; with bars of its progress."""
    with ProgressBars() as bars:
        yield Look(
            topics_given(arguments.topic),
            max_views=arguments.max_moments,
            strict=arguments.strict,
            workers=arguments.workers,
            scheduler=arguments.scheduler,
            log=Log(beside(arguments.output, "rig_detections.jsonl"), arguments.resume),
            on_progress=bars,
        )


def _calibrated(
    files: Mapping[str, CameraFile], sources: Mapping[str, RigSource], arguments: argparse.Namespace
) -> RigCalibration:
    cameras = [
        RigCamera(name, file.camera, sources[name].observations, sources[name].stamps_ns, file.covariance, file.board)
        for name, file in files.items()
    ]
    numbered = any(source.numbered for source in sources.values())
    return calibrate_rig(
        cameras,
        tolerance=0.0 if numbered else arguments.tolerance,
        unmistakable=arguments.unmistakable or all(source.unmistakable for source in sources.values()),
        warp_free=arguments.board_warp,
        find_clocks=arguments.time_offset == "auto",
    )


def _cameras(given: list[str]) -> dict[str, Path]:
    paths: dict[str, Path] = {}
    for text in given:
        name, equals, path = text.partition("=")
        if not equals or safe_name(name) != name:
            raise InputError(f"--camera {text}: give NAME=CAMERA.yaml, the name of letters, digits and _ . -")
        if name in paths:
            raise InputError(f"--camera: two cameras are called {name}")
        paths[name] = Path(path)
    if len(paths) < 2:
        raise InputError("a rig has two cameras at least: repeat --camera NAME=CAMERA.yaml")
    return paths


def _text(rig: RigCalibration, output: Path) -> str:
    lines = [
        f"{len(rig.names)} cameras, {rig.moments} common views, RMS {rig.rms_px:.4f} px; at the origin: {rig.names[0]}",
        f"  {'camera':<12}{'x mm':>10}{'y mm':>10}{'z mm':>10}{'± mm':>8}{'turned °':>10}{'± °':>9}{'RMS px':>9}",
    ]
    for number, name in enumerate(rig.names):
        pose = rig.reference_from_camera[number]
        x, y, z = 1e3 * pose[:3, 3]
        turn = np.degrees(np.arccos(np.clip((np.trace(pose[:3, :3]) - 1) / 2, -1, 1)))
        position = 1e3 * np.linalg.norm(rig.position_sigma[number])
        rotation = np.degrees(np.linalg.norm(rig.rotation_sigma[number]))
        rms = rig.camera_rms_px[number]
        lines.append(
            f"  {name:<12}{x:>10.3f}{y:>10.3f}{z:>10.3f}{position:>8.3f}{turn:>10.3f}{rotation:>9.4f}{rms:>9.4f}"
        )
        if len(rig.paths[number]) > 2:
            lines.append(f"    joined through {', '.join(rig.names[step] for step in rig.paths[number][1:-1])}")
    lines += [f"  {rig.names[pair.a]} and {rig.names[pair.b]}: {pair.views} common views" for pair in rig.pairs]
    lines += [
        f"  the clock of {name} is {1e-6 * abs(ns):.3f} ms {'ahead of' if ns > 0 else 'behind'} that of {rig.names[0]}"
        for name, ns in zip(rig.names, rig.clock_offsets_ns, strict=True)
        if ns
    ]
    if rig.board is not None:
        lines.append(f"  {rig.board.sentence}")
    if np.any(rig.board_warp):
        bow = ", ".join(f"{1e3 * value:+.3f}" for value in rig.board_warp)
        lines.append(f"  board warp (x, y, twist): {bow} mm")
    contradicting = [f"{rig.names[camera]} {image}" for camera, image in rig.left_out]
    if contradicting:
        more = f" and {len(contradicting) - 8} more" if len(contradicting) > 8 else ""
        lines.append(f"  not used, as they contradict the others: {', '.join(contradicting[:8])}{more}")
    lines.append(f"  wrote {output / RIG} and {output / CAMCHAIN}")
    return "\n".join(lines)
