"""What this finds of a target beside others, on the same images: `make benchmark`, or

    python benchmarks/peers/detection.py [--targets NAME ...] [--views N] [--data ../shared/data]

Rendered fisheye views of the shipped targets have a known truth; clutter without a target shows what is found of
nothing, and in what time; photographs have reference corners that other people's
programs measured. Recall: the share of the truth's points in sight with a point found within 2 px; where the target
tells which point is which, under its name. Wrong: points found with none of the target's within 2 px, or under the name
of another. Error: median of the distances, of photographs to the reference. Time is processor time an image of one
thread.
"""

from __future__ import annotations

import argparse
import os
import sys
import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path

os.environ.setdefault("OMP_NUM_THREADS", "1")
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
os.environ.setdefault("RAYON_NUM_THREADS", "1")

import cv2
import numpy as np
from finders import FINDERS, Finder, Found

from fisheye_ep_calib import Observations
from fisheye_ep_calib.simulation import clutter_image, paper_camera
from fisheye_ep_calib.simulation.evaluation_set import evaluation_set
from fisheye_ep_calib.target import Target, load_target, parse_target

NEAR = 2.0  # pixels
RENDERED = ("circle_grid_11x7", "chessboard_9x6", "charuco_10x7", "aprilgrid_6x5")
PHOTOGRAPHS = {
    "ov_plane": {"type": "chessboard", "columns": 22, "rows": 22, "spacing": 0.0075},
    "jy_left": {"type": "chessboard", "columns": 8, "rows": 6, "spacing": 0.04},
    "urban_fisheye2": {"type": "chessboard", "columns": 6, "rows": 8, "spacing": 0.117},
    "discocal_left": {"type": "circle_grid", "columns": 4, "rows": 3, "spacing": 0.09, "radius": 0.035},
}


@dataclass(frozen=True)
class Truth:
    """pixels (n, 2) of the target's points, NaN where unknown; seen (n,): wholly in sight, to be found."""

    pixels: np.ndarray
    seen: np.ndarray


@dataclass(frozen=True)
class Case:
    """A target and its images, each with its truth. complete: what is not in the truth is wrong."""

    target: Target
    images: list[np.ndarray]
    truths: list[Truth]
    complete: bool


def rendered(name: str, count: int) -> Case:
    camera, target = paper_camera(), load_target(name)
    views = evaluation_set(camera, target, seed=5)
    views = [views[i] for i in np.linspace(0, len(views) - 1, min(count, len(views))).astype(int)]
    images = [view.image(camera, target) for view in views]
    return Case(target, images, [Truth(view.pixels, view.visible) for view in views], True)


def clutter(name: str, count: int) -> Case:
    """Images of the same size in which there is no target: whatever is found is wrong."""
    camera, target = paper_camera(), load_target(name)
    images = [clutter_image(number, camera.image_size) for number in range(count)]
    points = len(target.object_points)
    nothing = Truth(np.full((points, 2), np.nan), np.zeros(points, dtype=bool))
    return Case(target, images, [nothing] * count, True)


def photographs(folder: Path) -> Case:
    """Images of a folder that have reference points; the references may have missed some."""
    target = parse_target(PHOTOGRAPHS[folder.name])
    reference = Observations.load(folder / "observations.npz")
    images, truths = [], []
    for path in sorted((folder / "images").iterdir()):
        numbers = [number for number, name in enumerate(reference.image_names) if Path(name).stem == path.stem]
        rows = np.isin(reference.image_index, numbers)
        if rows.any():
            images.append(cv2.imread(str(path), cv2.IMREAD_GRAYSCALE))
            truths.append(Truth(reference.pixels[rows], np.ones(int(rows.sum()), dtype=bool)))
    return Case(target, images, truths, False)


def judged(case: Case, found: list[Found]) -> dict[str, float | int]:
    errors, wrong = [], 0
    for truth, points in zip(case.truths, found, strict=True):
        distance = np.full((len(truth.pixels), len(points.pixels)), np.inf)
        both = np.linalg.norm(truth.pixels[:, None] - points.pixels, axis=-1)
        distance[np.isfinite(both)] = both[np.isfinite(both)]
        if points.names is not None and case.complete:
            distance[np.arange(len(truth.pixels))[:, None] != points.names] = np.inf
        nearest = distance.min(axis=1, initial=np.inf)
        errors.append(nearest[truth.seen & (nearest < NEAR)])
        wrong += int((distance.min(axis=0, initial=np.inf) >= NEAR).sum())
    total = sum(int(truth.seen.sum()) for truth in case.truths)
    right = np.concatenate(errors)
    return {
        "images": sum(len(points.pixels) > 0 for points in found),
        "recall": len(right) / total if total else float("nan"),
        "wrong": wrong,
        "error": float(np.median(right)) if len(right) else float("nan"),
    }


def rows(case: Case, limit: float) -> Iterator[list[str]]:
    for name, make in FINDERS[case.target.kind].items():
        try:
            finder = make(case.target)
        except ImportError as error:
            yield [name, f"not installed: {error.name}", "", "", "", ""]
            continue
        seconds, found = timed(finder, case.images, limit)
        if len(found) < len(case.images):
            yield [name, f"ended after {len(found)} images", "", "", "", f"{1000 * seconds:.0f}"]
            continue
        told = judged(case, found)
        yield [
            name,
            f"{told['images']} of {len(case.images)}",
            f"{told['recall']:.4f}".replace("nan", "–"),
            str(told["wrong"]) if case.complete else "–",
            f"{told['error']:.3f}".replace("nan", "–"),
            f"{1000 * seconds:.0f}",
        ]


def timed(finder: Finder, images: list[np.ndarray], limit: float) -> tuple[float, list[Found]]:
    """Processor seconds an image and what was found in those that could be looked at within the limit."""
    finder(images[0])  # to warm up
    found: list[Found] = []
    began = time.process_time()
    for image in images:
        if time.process_time() - began > limit:
            break
        found.append(finder(image))
    return (time.process_time() - began) / len(found), found


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--targets", nargs="*", help=f"of {', '.join([*RENDERED, *PHOTOGRAPHS])}")
    parser.add_argument("--views", type=int, default=21, help="rendered views of a target, at most")
    parser.add_argument("--limit", type=float, default=120.0, help="seconds of processor time a finder and set")
    parser.add_argument("--data", type=Path, default=Path(__file__).resolve().parents[3] / "shared" / "data")
    arguments = parser.parse_args()
    cv2.setNumThreads(1)
    cases: dict[str, Callable[[], Case]] = {
        name: lambda name=name: rendered(name, arguments.views) for name in RENDERED
    }
    cases |= {f"{name}, clutter": lambda name=name: clutter(name, arguments.views // 2) for name in RENDERED}
    if arguments.data.is_dir():
        cases |= {name: lambda name=name: photographs(arguments.data / name) for name in PHOTOGRAPHS}
    else:
        print(f"no photographs: {arguments.data} is not there", file=sys.stderr)
    for name, make in cases.items():
        if arguments.targets and name.split(",")[0] not in arguments.targets:
            continue
        print(
            f"### {name}\n\n|  | images | recall | wrong | median error, px | ms |\n|---|---|---|---|---|---|",
            flush=True,
        )
        for row in rows(make(), arguments.limit):
            print(f"| {' | '.join(row)} |", flush=True)
        print(flush=True)


if __name__ == "__main__":
    main()
