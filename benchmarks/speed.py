"""How long a calibration takes, as ratios within one process and one thread.

    OMP_NUM_THREADS=1 python benchmarks/speed.py [--quick]

``calibrate(observations, model="ep_odd")`` with nothing known, and of that initialization and adjustment alone, against
cv2.fisheye.calibrate that is given a good focal length; the full ``auto`` against one fit; and how the cost grows with
the number of views.
"""

from __future__ import annotations

import argparse
import resource
import statistics
import time
from functools import partial

import cv2
import numpy as np

from fisheye_ep_calib import Observations, calibrate
from fisheye_ep_calib.calibration.estimating.fit import first_fit, refine
from fisheye_ep_calib.calibration.estimating.sightings import prepare
from fisheye_ep_calib.calibration.structure import Structure
from fisheye_ep_calib.simulation import look_pose, paper_camera, paper_target
from fisheye_ep_calib.simulation.truth import points_in_camera


def scene(views: int, seed: int = 0, noise: float = 0.15) -> Observations:
    """11 × 7 points at 100–150 mm, all within 80° of the axis, where cv2.fisheye works."""
    rng = np.random.default_rng(seed)
    camera, target = paper_camera(), paper_target()
    poses = np.array(
        [
            look_pose(
                target,
                np.radians(42) * np.sqrt((view + 0.5) / views),
                2.399963 * view,
                rng.uniform(0.10, 0.15),
                np.radians(rng.uniform(0, 35)),
                rng.uniform(0, 2 * np.pi),
                rng.uniform(0, 2 * np.pi),
            )
            for view in range(views)
        ]
    )
    points = points_in_camera(poses, target.object_points)
    pixels, valid = camera.project(points)
    valid &= camera.incidence_angle(points) < np.radians(80)
    image, point = np.nonzero(valid)
    measured = pixels[image, point] + rng.normal(0, noise, (len(image), 2))
    return Observations.create(target.object_points, image, point, measured, camera.image_size)


def one_fit(observations: Observations):
    """The paper's three steps for ep_odd."""
    return refine(first_fit(prepare(observations)), Structure("ep_odd"))


def opencv(observations: Observations) -> float:
    """cv2.fisheye.calibrate with the true focal length; returns its RMS."""
    flags = cv2.fisheye if hasattr(cv2.fisheye, "CALIB_USE_INTRINSIC_GUESS") else cv2
    images = np.unique(observations.image_index)
    rows = [observations.image_index == image for image in images]
    objects = [observations.object_points[observations.point_index[row]][None] for row in rows]
    pixels = [observations.pixels[row][None] for row in rows]
    matrix = np.array([[592.0, 0, 1023.5], [0, 592.0, 1023.5], [0, 0, 1]])
    return cv2.fisheye.calibrate(
        objects,
        pixels,
        observations.image_size,
        matrix,
        np.zeros((4, 1)),
        flags=flags.CALIB_USE_INTRINSIC_GUESS | flags.CALIB_RECOMPUTE_EXTRINSIC,
        criteria=(cv2.TERM_CRITERIA_COUNT + cv2.TERM_CRITERIA_EPS, 100, 1e-6),
    )[0]


def seconds(function, *arguments, repeats: int) -> float:
    """Median over repeats after one run to warm up."""
    return alternated(lambda: function(*arguments), repeats=repeats)[0]


def alternated(*functions, repeats: int) -> list[float]:
    """Median seconds of each, run in turns so that a busy moment of the machine meets all of them."""
    taken: list[list[float]] = [[] for _ in functions]
    for turn in range(repeats + 1):
        for function, times in zip(functions, taken, strict=True):
            began = time.perf_counter()
            function()
            if turn:
                times.append(time.perf_counter() - began)
    return [statistics.median(times) for times in taken]


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--quick", action="store_true", help="without the 10,000 views")
    quick = parser.parse_args().quick
    cv2.setNumThreads(1)
    for views, repeats in ((25, 15), (200, 5)):
        observations = scene(views)
        named = partial(calibrate, observations, model="ep_odd")
        whole, fit, other = alternated(
            named, partial(one_fit, observations), partial(opencv, observations), repeats=repeats
        )
        print(
            f"{views} views: calibrate(observations, model='ep_odd') {whole:.4f} s (RMS {named().rms_px:.3f} px), "
            f"cv2.fisheye {other:.4f} s (RMS {opencv(observations):.3f} px): ratio {whole / other:.3f}; "
            f"one fit {fit:.4f} s: ratio {fit / other:.3f}"
        )
    observations = scene(25)
    own = seconds(one_fit, observations, repeats=9)
    full = seconds(calibrate, observations, repeats=3)
    print(f"auto, 25 views: {full:.3f} s = {full / own:.1f} × one fit")
    if quick:
        return
    thousand, many = scene(1000), scene(10_000)
    small = seconds(one_fit, thousand, repeats=2)
    began = time.perf_counter()
    fit = one_fit(many)
    large = time.perf_counter() - began
    peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 2**20
    print(
        f"1,000 views {small:.2f} s, 10,000 views {large:.2f} s ({fit.adjustment.iterations} iterations): "
        f"{large / small / 10:.2f} × linear; peak memory {peak:.2f} GiB"
    )


if __name__ == "__main__":
    main()
