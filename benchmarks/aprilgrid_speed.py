"""Time of the AprilGrid detector beside the package aprilgrid of PyPI, on the same images of 2048², one thread.

    python benchmarks/aprilgrid_speed.py [--views N]          (pip install --no-deps aprilgrid)

Rendered views of the shipped grid in good light, from which every tag can be read, hard ones of the evaluation set, and
clutter without a grid. Prints milliseconds an image, the ratio, and how many of the visible tag corners were found.
Without the package ours is measured alone, which is said.
"""

from __future__ import annotations

import argparse
import time

import cv2
import numpy as np

from fisheye_ep_calib.simulation import Imaging, clutter_image, feature_pixels, look_pose, paper_camera, render
from fisheye_ep_calib.simulation.evaluation_set import evaluation_set
from fisheye_ep_calib.target import load_target

ROUNDS = 3
NEAR = 2.0  # pixels from the truth: found


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--views", type=int, default=10, help="images of each kind")
    count = parser.parse_args().views
    cv2.setNumThreads(1)
    camera, target = paper_camera(), load_target("aprilgrid_6x5")
    detector = target.detector()
    runs = {"this package": lambda image: _placed(detector.detect(image), len(target.object_points))}
    try:
        from aprilgrid import Detector

        peer = Detector("t36h11")
        runs["aprilgrid"] = lambda image: _of_peer(peer.detect(image), target)
    except ImportError:
        print("skipped: the package aprilgrid is not installed (pip install --no-deps aprilgrid)")
    for kind, images, truths in _kinds(camera, target, count):
        spent = {}
        for name, run in runs.items():
            spent[name], places = _time(run, images)
            seen = sum(int(np.isfinite(truth[:, 0]).sum()) for truth in truths)
            found = sum(_found(*pair) for pair in zip(places, truths, strict=True))
            ratio = f"×{spent['this package'] / spent[name]:.2f}"
            print(f"{kind:10s} {name:14s} {1000 * spent[name]:7.1f} ms  {ratio}  {found} of {seen} corners", flush=True)


def _kinds(camera, target, count: int):
    """Name, images, and where the points are in each (n, 2), NaN where unseen."""
    rng = np.random.default_rng(5)
    poses = [
        look_pose(target, rng.uniform(0, 0.9), rng.uniform(0, 6.3), rng.uniform(0.15, 0.3), rng.uniform(0, 0.5))
        for _ in range(count)
    ]
    images = [render(camera, target, pose, Imaging(blur=0.7, noise=1.5, seed=i)) for i, pose in enumerate(poses)]
    yield "plain", images, [_inside(feature_pixels(camera, target, pose)[0]) for pose in poses]
    views = evaluation_set(camera, target, seed=5)
    views = [views[i] for i in np.linspace(0, len(views) - 1, count).astype(int)]
    truths = [np.where(view.visible[:, None], view.pixels, np.nan) for view in views]
    yield "hard", [view.image(camera, target) for view in views], truths
    nothing = [np.full((len(target.object_points), 2), np.nan)] * count
    yield "clutter", [clutter_image(number, camera.image_size) for number in range(count)], nothing


def _inside(pixels: np.ndarray) -> np.ndarray:
    return np.where(((pixels > 2) & (pixels < 2045)).all(axis=1)[:, None], pixels, np.nan)


def _placed(found, count: int) -> np.ndarray:
    pixels = np.full((count, 2), np.nan)
    pixels[found.point_index] = found.pixels
    return pixels


def _of_peer(tags, target) -> np.ndarray:
    """The peer's corners, at the places of their tags; the order within a tag does not matter here."""
    corners = np.full((len(target.tag_points), 4, 2), np.nan)
    for tag in tags:
        if tag.tag_id < len(corners):
            corners[tag.tag_id] = np.asarray(tag.corners).reshape(4, 2)
    pixels = np.full((len(target.object_points), 2), np.nan)
    pixels[target.tag_points.ravel()] = corners.reshape(-1, 2)
    return pixels


def _found(pixels: np.ndarray, truth: np.ndarray) -> int:
    """How many of the visible points are found, whatever their names within a tag."""
    places = pixels[np.isfinite(pixels[:, 0])]
    if len(places) == 0:
        return 0
    visible = truth[np.isfinite(truth[:, 0])]
    return int((np.linalg.norm(visible[:, None] - places, axis=-1).min(axis=1) < NEAR).sum())


def _time(run, images) -> tuple[float, list[np.ndarray]]:
    """Seconds an image (the best of some rounds, processor time of this process) and what was found."""
    best, places = np.inf, []
    for _ in range(ROUNDS):
        start = time.process_time()
        places = [run(image) for image in images]
        best = min(best, (time.process_time() - start) / len(images))
    return best, places


if __name__ == "__main__":
    main()
