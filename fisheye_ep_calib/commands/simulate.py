"""fisheye_ep_calib simulate: images of known cameras as a bag."""

from __future__ import annotations

import argparse
import re
import time
from collections.abc import Callable
from pathlib import Path

import numpy as np

from fisheye_ep_calib.collection.progress import progress_bar
from fisheye_ep_calib.commands.reporting import refuse_existing
from fisheye_ep_calib.errors import InputError
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
from fisheye_ep_calib.storage.camera_file import load_camera
from fisheye_ep_calib.storage.observation_file import save_observations
from fisheye_ep_calib.target import Target, load_target

DESCRIPTION = "Render a target as known cameras see it, and write the images as a bag."
BUILT_IN: dict[str, Callable[[], SceneCamera]] = {"paper": paper_camera, "laikin": laikin_camera}


def add_arguments(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("--output", required=True, type=Path, metavar="BAG.mcap", help="the bag to write")
    parser.add_argument("--overwrite", action="store_true", help="replace an earlier bag and truth")
    parser.add_argument(
        "--camera",
        action="append",
        metavar="NAME=CAMERA",
        help="a camera and what it is: a camera YAML, or one built in: 'paper' (Table 1 of the paper), 'laikin' "
        "(a ray-traced 170° lens); may be repeated (default: front=paper)",
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
        "--truth", type=Path, metavar="DIR", help="write where the points truly are: observation files NAME.npz"
    )


def run(arguments: argparse.Namespace) -> int:
    _check(arguments)
    target = paper_target() if arguments.target is None else load_target(arguments.target)
    rig: list[SimulatedCamera] = []
    for number, text in enumerate(arguments.camera or ["front=paper"]):
        name, camera = _camera(text)
        if any(other.name == name for other in rig):
            raise InputError(f"--camera: two cameras are called {name}")
        truth_file = None if arguments.truth is None else arguments.truth / f"{name}.npz"
        refuse_existing([arguments.output, truth_file], arguments.overwrite)
        views = _views(arguments, camera, target, arguments.seed + number)
        rig.append(SimulatedCamera(name, views))
        if truth_file is not None:
            save_observations(truth_file, observe(camera, target, np.stack([view.pose for view in views])))
    total = sum(len(camera.views) for camera in rig)
    images = simulate_rig(rig, arguments.rate, time.time_ns(), arguments.compression)
    count = write_bag(arguments.output, progress_bar(images, "rendering", total=total))
    print(f"wrote {count} images of {', '.join(camera.name for camera in rig)} to {arguments.output}")
    return 0


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


def _views(arguments: argparse.Namespace, camera: SceneCamera, target: Target, seed: int) -> tuple[View, ...]:
    if arguments.poses == "evaluation":
        return tuple(View(camera, target, view.pose, view.imaging) for view in evaluation_set(camera, target, seed))
    imaging = Imaging(noise=arguments.noise, blur=arguments.blur, vignetting=0.3, texture=30, seed=seed)
    if arguments.poses == "paper":
        return views_at(camera, target, paper_poses(target, seed), imaging)
    poses = random_poses(target, arguments.views, seed, tuple(arguments.distance))
    return views_at(camera, target, poses, imaging)
