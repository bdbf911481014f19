"""Time of the circle grid detector beside OpenCV's on the same rendered images, one thread.

    python benchmarks/detection.py [--views N]

Prints milliseconds an image for cv2.findCirclesGrid with default blobs, for the first pass and for the second, and what
each found.
"""

from __future__ import annotations

import argparse
import multiprocessing
import os
import time
from concurrent.futures import ProcessPoolExecutor

import cv2
import numpy as np

from fisheye_ep_calib.simulation import paper_camera, paper_target
from fisheye_ep_calib.simulation.evaluation_set import evaluation_set

ROUNDS = 3

_images: list[np.ndarray] = []


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--views", type=int, default=12, help="views of the evaluation set, evenly spaced")
    cv2.setNumThreads(1)
    camera, target = paper_camera(), paper_target()
    views = evaluation_set(camera, target)
    count = parser.parse_args().views
    views = [views[i] for i in np.linspace(0, len(views) - 1, count).astype(int)]
    images = [view.image(camera, target) for view in views]
    detector = target.detector()
    size = (target.columns, target.rows)
    flags = cv2.CALIB_CB_SYMMETRIC_GRID

    def opencv(image, view) -> int:
        found, centers = cv2.findCirclesGrid(image, size, flags=flags)
        return len(centers) if found else 0

    runs = {
        "cv2.findCirclesGrid": opencv,
        "first pass": lambda image, view: len(detector.detect(image)),
        "second pass": lambda image, view: len(detector.detect_guided(image, camera, view.pose)),
    }
    visible = sum(int(view.visible.sum()) for view in views)
    reference = None
    for name, run in runs.items():
        best, found = _time(run, images, views)
        reference = reference or best
        print(f"{name:20s} {1000 * best:7.1f} ms  ×{best / reference:.2f}  {found} of {visible} discs")
    _scaling(images)


def _time(run, images, views) -> tuple[float, int]:
    """Seconds an image (the best of some rounds, processor time of this process) and the discs found."""
    best, found = np.inf, 0
    for _ in range(ROUNDS):
        start = time.process_time()
        found = sum(run(image, view) for image, view in zip(images, views, strict=True))
        best = min(best, (time.process_time() - start) / len(images))
    return best, found


def _detect_one(image: int) -> int:
    cv2.setNumThreads(1)
    return len(paper_target().detector().detect(_images[image]))


def _scaling(images: list[np.ndarray]) -> None:
    """Wall time of the first pass in one process and in as many as there are cores, which share the images' memory."""
    _images.extend(images)
    jobs = list(range(len(images))) * ROUNDS
    walls = {}
    for workers in dict.fromkeys((1, os.cpu_count() or 1)):
        with ProcessPoolExecutor(workers, multiprocessing.get_context("fork")) as pool:
            list(pool.map(_detect_one, jobs))  # the processes have started
            start = time.perf_counter()
            list(pool.map(_detect_one, jobs))
            walls[workers] = time.perf_counter() - start
    first = walls[1]
    for workers, wall in walls.items():
        print(f"{workers} process(es): {wall:.2f} s, ×{first / wall:.2f} as fast")


if __name__ == "__main__":
    main()
