"""Processor seconds of whole commands against an earlier commit, and of the engine against cv2.fisheye.

    python benchmarks/end_to_end.py add347b [--data ../shared/data/ov_plane] [--runs 5] [--only WORD]

The commit is checked out into a temporary folder and run with this interpreter and its packages, both with one
numerical thread and compiled beforehand; user and system time of the command and all of its children, the two in turn;
medians. What ``calibrate`` reads: a real observation file with the model named, twelve rendered images of discs with
one worker, the observation file and its images with everything left to ``auto``. The engine, initialization and
adjustment of ``ep_odd`` from nothing, is timed in this process against cv2.fisheye.calibrate with a good focal length
(speed.py).
"""

from __future__ import annotations

import argparse
import compileall
import os
import resource
import shutil
import statistics
import subprocess
import sys
import tempfile
from collections.abc import Sequence
from functools import partial
from pathlib import Path

import cv2
from monte_carlo import markdown
from speed import alternated, one_fit, opencv, scene

from fisheye_ep_calib.simulation import Imaging, paper_camera, paper_poses, paper_target, render_views, views_at

HERE = Path(__file__).resolve().parents[1]
ONE_THREAD = dict.fromkeys(("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS"), "1")
CHESSBOARD = "type: chessboard\ncolumns: 22\nrows: 22\nspacing: 0.0075\n"  # of ov_plane
CIRCLES = HERE / "config" / "targets" / "circle_grid_11x7.yaml"
ENGINE = {25: (0.10, 15), 100: (0.05, 7), 400: (0.02, 3)}  # views: limit of the ratio, repeats


def seconds(package: Path, arguments: Sequence[str | Path]) -> float:
    """User and system time of ``calibrate`` and its children, of the package in a folder."""
    environment = os.environ | ONE_THREAD | {"PYTHONPATH": str(package)}
    before = resource.getrusage(resource.RUSAGE_CHILDREN)
    with tempfile.TemporaryDirectory() as elsewhere:
        command = [sys.executable, "-m", "fisheye_ep_calib", "calibrate", *arguments, "--output", "result"]
        subprocess.run(command, env=environment, cwd=elsewhere, check=True, capture_output=True)
    after = resource.getrusage(resource.RUSAGE_CHILDREN)
    return after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime


def rendered(folder: Path) -> Path:
    """Twelve images of the paper's target and camera."""
    camera, target = paper_camera(), paper_target()
    views = views_at(camera, target, paper_poses(target, 0)[::2][:12], Imaging(seed=1))
    folder.mkdir()
    for number, image in enumerate(render_views(views, 1)):
        cv2.imwrite(str(folder / f"{number:02d}.png"), image)
    return folder


def cases(data: Path, folder: Path) -> dict[str, tuple[list[str | Path], float]]:
    """Arguments of ``calibrate`` by what they try, and the limit of the ratio."""
    named: list[str | Path] = ["--model", "ep_odd"]
    found: dict[str, tuple[list[str | Path], float]] = {
        "12 images of discs, ep_odd, one worker": (
            [rendered(folder / "discs"), "--target", CIRCLES, "--workers", "1", *named],
            0.6,
        )
    }
    if not (data / "observations.npz").exists():
        print(f"{data} is not there: without the real recording")
        return found
    board = folder / "chessboard.yaml"
    board.write_text(CHESSBOARD)
    found["observations, ep_odd"] = ([data / "observations.npz", *named], 0.5)
    found["observations, auto"] = ([data / "observations.npz"], 1.5)
    found["25 images of a chessboard, auto"] = ([data / "images", "--target", board], 1.0)
    return found


def engine() -> list[tuple[str, ...]]:
    cv2.setNumThreads(1)
    rows = []
    for views, (limit, repeats) in ENGINE.items():
        observations = scene(views)
        own, other = alternated(partial(one_fit, observations), partial(opencv, observations), repeats=repeats)
        rows.append(
            (
                f"start and fit, {views} views, against cv2.fisheye",
                f"{other:.3f}",
                f"{own:.3f}",
                f"{own / other:.3f}",
                f"{limit}",
            )
        )
        print(*rows[-1], flush=True)
    return rows


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("commit", help="against which to measure")
    parser.add_argument("--data", type=Path, default=HERE.parent / "shared" / "data" / "ov_plane")
    parser.add_argument("--runs", type=int, default=5)
    parser.add_argument("--only", default="", help="a word of the cases' names, or engine")
    given = parser.parse_args()
    rows: list[tuple[str, ...]] = []
    with tempfile.TemporaryDirectory() as folder:
        before = Path(folder) / "before"
        subprocess.run(["git", "-C", HERE, "worktree", "add", "--detach", before, given.commit], check=True)
        try:
            for package in (before, HERE):
                compileall.compile_dir(package / "fisheye_ep_calib", quiet=2)
            for name, (arguments, limit) in cases(given.data.resolve(), Path(folder)).items():
                if given.only not in name:
                    continue
                taken = [[seconds(package, arguments) for package in (before, HERE)] for _ in range(given.runs)]
                old, new = (statistics.median(each) for each in zip(*taken, strict=True))
                rows.append((name, f"{old:.2f}", f"{new:.2f}", f"{new / old:.2f}", f"{limit}"))
                print(*rows[-1], flush=True)
        finally:
            shutil.rmtree(before)
            subprocess.run(["git", "-C", HERE, "worktree", "prune"], check=True)
    if given.only in ("", "engine"):
        rows += engine()
    print(markdown(("", "before, s", "now, s", "ratio", "wanted at most"), rows))


if __name__ == "__main__":
    main()
