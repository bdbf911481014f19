"""fisheye_ep_calib simulate: images of known cameras as a bag."""

from __future__ import annotations

import argparse
import re
import time
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np

from fisheye_ep_calib.collection.progress import progress_bar
from fisheye_ep_calib.errors import InputError
from fisheye_ep_calib.pipeline.writing import refuse_existing
from fisheye_ep_calib.simulation import (
    Imaging,
    SceneCamera,
    SimulatedCamera,
    View,
    evaluation_set,
    laikin_camera,
    observe,
    paper_camera,
    paper_poses,
    paper_target,
    random_poses,
    simulate_rig,
    views_at,
    write_bag,
)
from fisheye_ep_calib.storage.atomic import atomic_write
from fisheye_ep_calib.storage.camera_file import load_camera
from fisheye_ep_calib.storage.observation_file import save_observations
from fisheye_ep_calib.storage.rig_file import RIG, places_yaml
from fisheye_ep_calib.target import Target, load_target

DESCRIPTION = "Render a target as known cameras see it, several at the same time, and write the images as a bag."
BUILT_IN: dict[str, Callable[[], SceneCamera]] = {"paper": paper_camera, "laikin": laikin_camera}


def add_arguments(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("--output", required=True, type=Path, metavar="BAG.mcap", help="the bag to write")
    parser.add_argument("--overwrite", action="store_true", help="replace an earlier bag and truth")
    parser.add_argument(
        "--camera",
        action="append",
        metavar="NAME=CAMERA",
        help="a camera and what it is: a camera YAML, or one built in: 'paper' (Table 1 of the paper), 'laikin' "
        "(a ray-traced 170° lens); repeated: a rig, which sees one target at the same time (default: front=paper)",
    )
    parser.add_argument(
        "--baseline",
        type=float,
        default=0.06,
        metavar="METRES",
        help="how far each camera of a rig is to the right of the one before (default: 0.06)",
    )
    parser.add_argument("--target", type=Path, metavar="TARGET.yaml", help="default: the paper's 11 × 7 discs")
    parser.add_argument(
        "--poses",
        choices=("paper", "random", "evaluation"),
        default="paper",
        help="paper: 25 poses at 100–150 mm; random: --views poses at --distance; evaluation: 42 poses that try "
        "a detector (default: paper)",
    )
    parser.add_argument("--views", type=int, default=25, help="number of random poses (default: 25)")
    parser.add_argument(
        "--distance",
        nargs=2,
        type=float,
        default=(0.10, 0.15),
        metavar=("NEAR", "FAR"),
        help="range of random poses, metres (default: 0.10 0.15)",
    )
    parser.add_argument("--noise", type=float, default=2.0, help="sensor noise, grey levels (default: 2)")
    parser.add_argument("--blur", type=float, default=0.7, help="σ of the blur, pixels (default: 0.7)")
    parser.add_argument("--rate", type=float, default=2.0, help="images a second (default: 2)")
    parser.add_argument("--compression", choices=("png", "jpeg"), default="", help="write CompressedImage")
    parser.add_argument("--seed", type=int, default=0, help="another seed, other poses and noise (default: 0)")
    parser.add_argument(
        "--truth",
        type=Path,
        metavar="DIR",
        help="write where the points truly are: observation files NAME.npz; and of several cameras rig.yaml",
    )


def run(arguments: argparse.Namespace) -> int:
    _check(arguments)
    target = paper_target() if arguments.target is None else load_target(arguments.target)
    cameras: dict[str, SceneCamera] = {}
    for text in arguments.camera or ["front=paper"]:
        name, camera = _camera(text)
        if name in cameras:
            raise InputError(f"--camera: two cameras are called {name}")
        cameras[name] = camera
    places = places_beside_each_other(list(cameras), arguments.baseline)
    rig_file = None if arguments.truth is None or len(cameras) == 1 else arguments.truth / RIG
    truth_files = {name: arguments.truth / f"{name}.npz" for name in cameras} if arguments.truth is not None else {}
    refuse_existing([arguments.output, rig_file, *truth_files.values()], arguments.overwrite)
    views = _views(arguments, next(iter(cameras.values())), target)
    rig = [
        SimulatedCamera(name, _seen_by(camera, views, places[name], n))
        for n, (name, camera) in enumerate(cameras.items())
    ]
    for member in rig:
        if member.name in truth_files:
            poses = np.stack([view.pose for view in member.views])
            save_observations(truth_files[member.name], observe(cameras[member.name], target, poses))
    if rig_file is not None:
        atomic_write(rig_file, places_yaml(places).encode())
    total = sum(len(camera.views) for camera in rig)
    images = simulate_rig(rig, arguments.rate, time.time_ns(), arguments.compression)
    count = write_bag(arguments.output, progress_bar(images, "rendering", total=total))
    print(f"wrote {count} images of {', '.join(camera.name for camera in rig)} to {arguments.output}")
    return 0


def places_beside_each_other(names: list[str], baseline: float) -> dict[str, np.ndarray]:
    """reference_from_camera (4, 4), metres, by name: each camera to the right of the one before, all looking ahead."""
    places = {}
    for number, name in enumerate(names):
        places[name] = np.eye(4)
        places[name][0, 3] = number * baseline
    return places


def _check(arguments: argparse.Namespace) -> None:
    near, far = arguments.distance
    if arguments.views < 1:
        raise InputError("--views must be at least 1")
    if not 0 < near <= far < np.inf:
        raise InputError("--distance takes two lengths in metres, the nearer first")
    if not 0 < arguments.rate < np.inf:
        raise InputError("--rate must be positive")
    if not (0 <= arguments.noise < 256 and 0 <= arguments.blur < 100):
        raise InputError("--noise must lie in 0..255 grey levels and --blur in 0..100 pixels")
    if not abs(arguments.baseline) < np.inf:
        raise InputError("--baseline takes a length in metres")
    if arguments.seed < 0:
        raise InputError("--seed must not be negative")


def _camera(text: str) -> tuple[str, SceneCamera]:
    """A camera given as NAME=CAMERA."""
    name, equals, source = text.partition("=")
    if not equals or not re.fullmatch(r"[A-Za-z][A-Za-z0-9_]*", name):
        raise InputError(f"--camera {text}: give NAME=CAMERA, the name of letters, digits and _")
    if source in BUILT_IN:
        return name, BUILT_IN[source]()
    return name, load_camera(source)


def _views(arguments: argparse.Namespace, camera: SceneCamera, target: Target) -> tuple[View, ...]:
    """What the first camera is shown."""
    seed = arguments.seed
    if arguments.poses == "evaluation":
        return tuple(View(camera, target, view.pose, view.imaging) for view in evaluation_set(camera, target, seed))
    imaging = Imaging(noise=arguments.noise, blur=arguments.blur, vignetting=0.3, texture=30, seed=seed)
    if arguments.poses == "paper":
        return views_at(camera, target, paper_poses(target, seed), imaging)
    poses = random_poses(target, arguments.views, seed, tuple(arguments.distance))
    return views_at(camera, target, poses, imaging)


def _seen_by(
    camera: SceneCamera, views: tuple[View, ...], reference_from_camera: np.ndarray, number: int
) -> tuple[View, ...]:
    """The views of the first camera as another one of the rig sees them, with noise of its own."""
    camera_from_reference = np.linalg.inv(reference_from_camera)
    return tuple(
        replace(
            view,
            camera=camera,
            pose=camera_from_reference @ view.pose,
            imaging=replace(view.imaging, seed=view.imaging.seed + 100_000 * number),
        )
        for view in views
    )
