"""Calibrating from a long recording: what reading costs, and what looking at few images loses.

    python benchmarks/reading.py make /tmp/two_cameras.mcap [--frames 2000]
    python benchmarks/reading.py run  /tmp/two_cameras.mcap
    python benchmarks/reading.py all  /tmp/two_cameras.mcap

``make`` renders two cameras of 2048² before a board that is moved by hand, one MCAP of 2 × 4 MiB a frame (16.8 GB).
``run`` compares, from a cold cache, a plain AnyReader pass with opening the recording and reading the images that are
chosen; times the search with one worker and two, by turns; and reports the memory. ``all`` looks at every image, and
compares its E(θ) with that of the images that are chosen.
"""

from __future__ import annotations

import argparse
import os
import resource
import time
from pathlib import Path

import numpy as np

from fisheye_ep_calib import calibrate
from fisheye_ep_calib.collection import Collector, FrameChoice
from fisheye_ep_calib.simulation import (
    Imaging,
    SimulatedCamera,
    look_pose,
    paper_camera,
    paper_target,
    simulate_rig,
    views_at,
    write_bag,
)
from fisheye_ep_calib.storage.recording import open_recording

TARGET = paper_target()
CAMERAS = {"front": paper_camera(0), "rear": paper_camera(1)}
TOPICS = tuple(f"/{name}/image_raw" for name in CAMERAS)
RATE = 30.0


def handheld_poses(frames: int, seed: int, nearest: float = 0.08, farthest: float = 0.5) -> np.ndarray:
    """Poses (frames, 4, 4) of a board moved smoothly from place to place, a new one every 1.5 s."""
    from scipy.interpolate import CubicSpline  # not above: every worker process imports this file's head

    rng = np.random.default_rng([seed, 7])
    places = int(frames / RATE / 1.5) + 4
    theta, azimuth = np.radians(85 * np.sqrt(rng.uniform(size=places))), rng.uniform(0, 2 * np.pi, places)
    keys = np.stack(
        [
            theta * np.cos(azimuth),
            theta * np.sin(azimuth),
            np.log(rng.uniform(nearest, farthest, places)),
            *np.radians(rng.uniform(-35, 35, (2, places))),
            np.cumsum(rng.normal(0, 0.5, places)),
        ],
        axis=1,
    )
    moved = CubicSpline(1.5 * np.arange(places), keys)(np.arange(frames) / RATE + 1.5)
    return np.stack(
        [
            look_pose(
                TARGET,
                theta=min(np.hypot(x, y), np.radians(90)),
                azimuth=np.arctan2(y, x),
                distance=float(np.exp(np.clip(log_distance, np.log(nearest), np.log(1.2 * farthest)))),
                tilt=min(np.hypot(tilt_x, tilt_y), 0.9),
                tilt_azimuth=np.arctan2(tilt_y, tilt_x),
                roll=roll,
            )
            for x, y, log_distance, tilt_x, tilt_y, roll in moved
        ]
    )


def make(path: Path, frames: int) -> None:
    imaging = Imaging(blur=0.7, noise=2.0)
    rig = [
        SimulatedCamera(name, views_at(camera, TARGET, handheld_poses(frames, seed), imaging))
        for seed, (name, camera) in enumerate(CAMERAS.items())
    ]
    started = time.perf_counter()
    count = write_bag(path, simulate_rig(rig, RATE, 1_700_000_000_000_000_000))
    print(f"{path}: {count} images, {path.stat().st_size / 1e9:.1f} GB, in {time.perf_counter() - started:.0f} s")


def forget_cache(path: Path) -> None:
    """Have the kernel read the file from the disk again."""
    descriptor = os.open(path, os.O_RDONLY)
    os.fsync(descriptor)
    os.posix_fadvise(descriptor, 0, 0, os.POSIX_FADV_DONTNEED)
    os.close(descriptor)


def plain_pass(path: Path) -> float:
    from rosbags.highlevel import AnyReader
    from rosbags.typesys import Stores, get_typestore

    started = time.perf_counter()
    with AnyReader([path], default_typestore=get_typestore(Stores.ROS2_JAZZY)) as reader:
        count = sum(1 for _ in reader.messages())
    seconds = time.perf_counter() - started
    print(f"plain AnyReader pass: {seconds:.2f} s for {count} messages, none deserialized")
    return seconds


def search(path: Path, workers: int, choice: FrameChoice):
    """Runs by topic, seconds in all, and seconds to open the recording and read what was looked at."""
    started = time.perf_counter()
    with open_recording(path) as recording:
        opened = time.perf_counter() - started
        with Collector(recording, TARGET, workers=workers) as collector:
            runs = collector.collect(TOPICS, choice)
    seconds = time.perf_counter() - started
    return runs, seconds, opened + sum(run.read_seconds for run in runs.values())


def observations_of(run):
    return run.observations(TARGET.object_points, TARGET.disc_radius)


def pupil_band(result, theta: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """E(θ) and its σ, metres: E is linear in its coefficients."""
    camera = result.camera
    columns = camera.parameter_slice("coefficients")
    covariance = result.uncertainty.covariance[columns, columns]
    basis = camera.pupil_family.basis(theta, len(camera.coefficients))
    return camera.entrance_pupil(theta), np.sqrt(np.einsum("it,ij,jt->t", basis, covariance, basis))


def run(path: Path) -> None:
    forget_cache(path)
    plain = plain_pass(path)
    forget_cache(path)
    runs, cold, reading = search(path, 1, FrameChoice())
    print(f"opening and reading what was chosen: {reading:.2f} s, {reading / plain:.3f} of the plain pass")
    for one in runs.values():
        print(f"  {one.summary()}")
    timed: dict[int, list[float]] = {}
    for workers in (1, 2, 1, 2, 4):
        again, seconds, _ = search(path, workers, FrameChoice())
        timed.setdefault(workers, []).append(seconds)
        same = all(
            observations_of(again[topic]).pixels.tobytes() == observations_of(runs[topic]).pixels.tobytes()
            for topic in TOPICS
        )
        print(f"{workers} workers: {seconds:.2f} s, same result: {same}")
    ratios = [f"{one / two:.2f}" for one, two in zip(timed[1], timed[2], strict=True)]
    print(f"two workers are {' and '.join(ratios)} × one (opening and the start of the processes included)")
    own, child = (resource.getrusage(who).ru_maxrss / 1e6 for who in (resource.RUSAGE_SELF, resource.RUSAGE_CHILDREN))
    print(f"peak memory: {own:.2f} GB here and at most {child:.2f} GB in each worker")


def look_at_all(path: Path) -> None:
    theta = np.radians(np.arange(10, 91, 10))
    runs, seconds, _ = search(path, 2, FrameChoice())
    print(f"chosen images, two workers: {seconds:.1f} s")
    few = {topic: calibrate(observations_of(one), "ep_odd") for topic, one in runs.items()}
    report(few, theta, "chosen images")
    every, seconds, _ = search(path, 2, FrameChoice(every=1))
    print(f"all images, two workers: {seconds:.1f} s")
    full = {topic: calibrate(observations_of(one), "ep_odd") for topic, one in every.items()}
    report(full, theta, "all images")
    for topic in TOPICS:
        (pupil, band), (pupil_all, band_all) = pupil_band(few[topic], theta), pupil_band(full[topic], theta)
        print(f"{topic}: |E − E of all| / 2σ of all: {np.round(np.abs(pupil - pupil_all) / (2 * band_all), 2)}")
        print(f"{topic}: σ / σ of all: {np.round(band / band_all, 2)}")


def report(results, theta: np.ndarray, what: str) -> None:
    for (topic, result), camera in zip(results.items(), CAMERAS.values(), strict=True):
        pupil, band = pupil_band(result, theta)
        print(f"{topic}, {what}: {result.views} views, RMS {result.rms_px:.4f} px, at {np.degrees(theta)}°:")
        print(f"  E − truth (µm): {np.round(1e6 * (pupil - camera.entrance_pupil(theta)), 1)}")
        print(f"  σ of E (µm):    {np.round(1e6 * band, 1)}")


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("what", choices=("make", "run", "all"))
    parser.add_argument("bag", type=Path)
    parser.add_argument("--frames", type=int, default=2000)
    arguments = parser.parse_args()
    if arguments.what == "make":
        make(arguments.bag, arguments.frames)
    elif arguments.what == "run":
        run(arguments.bag)
    else:
        look_at_all(arguments.bag)


if __name__ == "__main__":
    main()
