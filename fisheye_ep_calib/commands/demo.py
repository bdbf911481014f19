"""fisheye_ep_calib demo: the whole way once, on rendered images whose truth is known."""

from __future__ import annotations

import argparse
import time
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from fisheye_ep_calib.calibration import CalibrationResult, calibrate
from fisheye_ep_calib.camera import FisheyeCamera
from fisheye_ep_calib.collection.progress import ProgressBars, progress_bar
from fisheye_ep_calib.commands.live_demo import play_to_calibrator, why_not_live
from fisheye_ep_calib.pipeline import find_target
from fisheye_ep_calib.simulation import (
    Imaging,
    SimulatedCamera,
    paper_camera,
    paper_poses,
    paper_target,
    simulate_rig,
    views_at,
    write_bag,
)
from fisheye_ep_calib.storage.atomic import atomic_write
from fisheye_ep_calib.storage.camera_file import save_camera
from fisheye_ep_calib.storage.observation_file import save_observations

DESCRIPTION = (
    "Render the paper's target through the camera of its Table 1, twice; calibrate the images offline and, where "
    "rclpy is installed, with the live node over DDS."
)
CAMERAS = ("front", "rear")
MODELS = ("kannala", "ep_odd")
REPORT = "report.html"
RATE = 1.5  # images a second of each camera: slow enough for the live node to look at them all
PUPIL_ANGLES = (30, 60, 75)  # degrees
TARGET_YAML = """\
# The paper's 11 × 7 discs. Lengths in metres.
type: circle_grid
columns: 11
rows: 7
spacing: 0.012
radius: 0.004
"""


def add_arguments(parser: argparse.ArgumentParser) -> None:
    parser.add_argument(
        "--output",
        type=Path,
        default=Path("fisheye_ep_calib_demo"),
        metavar="DIR",
        help="folder for all files (default: fisheye_ep_calib_demo)",
    )
    parser.add_argument("--no-live", action="store_true", help="only the offline part")


def run(arguments: argparse.Namespace) -> int:
    began = time.monotonic()
    folder: Path = arguments.output
    bag, target_file = folder / "demo.mcap", folder / "target.yaml"
    truth = {name: paper_camera(number) for number, name in enumerate(CAMERAS)}
    atomic_write(target_file, TARGET_YAML.encode())
    _heading("1. Render: two fisheye cameras with an entrance pupil look at 11 × 7 discs, 25 views each")
    _render(bag, truth)
    _heading("2. Offline: find the discs, calibrate a single-viewpoint model and the entrance-pupil model")
    results = _calibrate_bag(bag, folder)
    for name, fits in results.items():
        print(_table(name, truth[name], fits))
    print(f"\nfigures of what was found and how far it can be trusted: {folder / REPORT}")
    _heading("3. Live: the same bag, played to the node over DDS")
    live = _live(bag, target_file, folder, "--no-live was given" if arguments.no_live else why_not_live())
    _closing(folder, live, time.monotonic() - began)
    return 0


def _render(bag: Path, cameras: dict[str, FisheyeCamera]) -> None:
    target = paper_target()
    imaging = Imaging(noise=2, blur=0.7, vignetting=0.3, texture=30)
    rig = [
        SimulatedCamera(name, views_at(camera, target, paper_poses(target, seed=number), imaging))
        for number, (name, camera) in enumerate(cameras.items())
    ]
    total = sum(len(camera.views) for camera in rig)
    images = simulate_rig(rig, RATE, time.time_ns())
    write_bag(bag, progress_bar(images, "rendering", total=total))
    print(f"wrote {bag}: {total} images of 2048 × 2048, {bag.stat().st_size / 1e6:.0f} MB")


def _calibrate_bag(bag: Path, folder: Path) -> dict[str, dict[str, CalibrationResult]]:
    """Each camera's results by model; the entrance-pupil cameras are saved as camera files, with a page of figures."""
    from fisheye_ep_calib.report.from_calibration import calibration_report
    from fisheye_ep_calib.report.html import write_report

    results = {}
    topics = {name: f"/{name}/image_raw" for name in CAMERAS}
    with ProgressBars() as bars:
        cameras_seen = find_target(bag, paper_target(), topics=topics, on_progress=bars)
    for name, observations in cameras_seen.items():
        save_observations(folder / "observations" / f"{name}.npz", observations)
        results[name] = {model: calibrate(observations, model) for model in MODELS}
        save_camera(folder / f"{name}.yaml", results[name]["ep_odd"], name, str(bag))
    write_report(
        folder / REPORT,
        [calibration_report(name, seen, results[name]["ep_odd"]) for name, seen in cameras_seen.items()],
    )
    return results


def _table(name: str, truth: FisheyeCamera, fits: dict[str, CalibrationResult]) -> str:
    """Parameters of the fits beside the truth."""
    cameras = [truth, *(fit.camera for fit in fits.values())]
    rows = [
        ("fx", "px", [camera.fx for camera in cameras], 2),
        ("fy", "px", [camera.fy for camera in cameras], 2),
        ("skew", "px", [camera.skew for camera in cameras], 3),
        ("cx", "px", [camera.cx for camera in cameras], 2),
        ("cy", "px", [camera.cy for camera in cameras], 2),
    ]
    for angle in PUPIL_ANGLES:
        pupils = [1e3 * float(camera.entrance_pupil(np.radians(angle))) for camera in cameras]
        rows.append((f"E({angle}°)", "mm", pupils, 3))
    lines = [f"{name:<9}{'':>4}{'truth':>11}" + "".join(f"{model:>11}" for model in fits)]
    for label, unit, values, digits in rows:
        lines.append(f"{label:<9}{unit:>4}" + "".join(f"{value:>11.{digits}f}" for value in values))
    lines.append(f"{'RMS':<9}{'px':>4}{'':>11}" + "".join(f"{fit.rms_px:>11.3f}" for fit in fits.values()))
    return "\n" + "\n".join(lines)


def _live(bag: Path, target_file: Path, folder: Path, obstacle: str) -> bool:
    """Whether the live part was shown; where it cannot be, it says why."""
    if obstacle:
        print(f"left out: {obstacle}")
        return False
    result = play_to_calibrator(bag, CAMERAS, target_file, folder, "ep_odd", print)
    print(f"it answered: {result.answer}")
    for name, info in result.infos.items():
        print(f"\n/{name}/camera_info\n{_camera_info(info)}")
    return True


def _camera_info(info: Mapping[str, Any]) -> str:
    """A CameraInfo as text."""
    return "\n".join(
        [
            f"  header: {info['stamp']}, {info['frame_id']}",
            f"  {info['width']} × {info['height']}, {info['distortion_model']}",
            f"  d: [{', '.join(f'{value:.6f}' for value in info['d'])}]",
            f"  k: [{', '.join(f'{value:.3f}' for value in info['k'])}]",
            f"  p: [{', '.join(f'{value:.3f}' for value in info['p'])}]",
        ]
    )


def _heading(text: str) -> None:
    print(f"\n{text}\n{'-' * len(text)}", flush=True)


def _closing(folder: Path, live: bool, seconds: float) -> None:
    _heading(f"Done in {seconds:.0f} s")
    files = {
        "demo.mcap": "the images; plays with ros2 bag play",
        "target.yaml": "what was seen",
        "front.yaml, rear.yaml": "the cameras: CameraInfo for every ROS consumer, and the whole model",
        REPORT: "the verdict and its figures; open it in a browser",
        "observations/": "the detected points; calibrate them again without the images",
    }
    if live:
        files["live/"] = "the same, as the node wrote it"
        files["calibrator.yaml, calibrator.log"] = "the node's parameters and what it said"
    print(f"In {folder}/:")
    for name, what in files.items():
        print(f"  {name:<32}{what}")
    topics = " ".join(f"--topic {name}=/{name}/image_raw" for name in CAMERAS)
    print(
        "\nNext:\n"
        f"  open {folder / REPORT} in a browser\n"
        f"  fisheye_ep_calib show {folder}/front.yaml\n"
        f"  fisheye_ep_calib calibrate {folder}/demo.mcap --target {folder}/target.yaml --output {folder}/again \\\n"
        f"      {topics}\n"
        "  fisheye_ep_calib calibrate YOUR_BAG --target YOUR_TARGET.yaml"
    )
