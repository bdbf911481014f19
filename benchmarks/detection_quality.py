"""What the detectors find: rendered views of every shipped target with known truth, and real photographs.

    PYTHONPATH=test/support python benchmarks/detection_quality.py [--seed N] [--target NAME]...

Each target is also seen in the negative; an AprilGrid with its tags turned within their cells, a ChArUco board of an
even number of square rows in the older layout of OpenCV, chessboards with a white first square.

The second pass of rendered views is guided by the true camera and pose, that of photographs by a calibration of
what the first pass found. FISHEYE_EP_CALIB_DATA names the folder with the photographs; without it they are left out.
"""

from __future__ import annotations

import argparse
import os
from dataclasses import fields, replace
from pathlib import Path

import cv2
import numpy as np
from detection_scores import evaluate

from fisheye_ep_calib import Observations, calibrate
from fisheye_ep_calib.simulation import clutter_image, paper_camera
from fisheye_ep_calib.simulation.evaluation_set import EvaluationView, evaluation_set
from fisheye_ep_calib.target import Artwork, Target, load_target, parse_target
from fisheye_ep_calib.target.boards.aprilgrid import AprilGrid
from fisheye_ep_calib.target.boards.charuco import Charuco
from fisheye_ep_calib.target.boards.chessboard import Chessboard
from fisheye_ep_calib.target.second_look import look_again

TARGETS = sorted((Path(__file__).resolve().parents[1] / "config" / "targets").glob("*.yaml"))
CLUTTER = 200
PHOTOGRAPHS = {
    "ov_plane": {"type": "chessboard", "columns": 22, "rows": 22, "spacing": 0.0075},
    "jy_left": {"type": "chessboard", "columns": 8, "rows": 6, "spacing": 0.04},
    "urban_fisheye2": {"type": "chessboard", "columns": 6, "rows": 8, "spacing": 0.117},
    "discocal_left": {"type": "circle_grid", "columns": 4, "rows": 3, "spacing": 0.09, "radius": 0.035},
}


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--seed", type=int, default=5, help="of the rendered views")
    parser.add_argument("--target", action="append", default=[], help="a shipped target or a folder of photographs")
    arguments = parser.parse_args()
    cv2.setNumThreads(1)

    def wanted(name: str) -> bool:
        return not arguments.target or name in arguments.target

    for path in filter(lambda path: wanted(path.stem), TARGETS):
        rendered(path, arguments.seed)
    data = os.environ.get("FISHEYE_EP_CALIB_DATA")
    for name, keys in PHOTOGRAPHS.items() if data else ():
        if not wanted(name):
            continue
        photographs(Path(data) / name, keys)


def rendered(path: Path, seed: int) -> None:
    """One shipped target, what else is printed for it, and images without it."""
    camera, target = paper_camera(), load_target(path)
    views = evaluation_set(camera, target, seed=seed)
    for kind, file, printed, seen in [
        ("", target, target, views),
        ("negative", target, target, [negative(view) for view in views[::3]]),
        *(
            (kind, file, printed, evaluation_set(camera, printed, seed=seed)[::3])
            for kind, file, printed in others(target)
        ),
    ]:
        for name, score in zip(("first pass", "second pass"), evaluate(camera, file, seen, printed), strict=True):
            print(
                f"{target.name:28s} {kind:16s} {name:12s} found {score.share:.4f}"
                f" in {score.views_found} of {len(seen)} views,"
                f" mislabelled {score.mislabelled}, median error {score.median_error:.4f} px",
                flush=True,
            )
    detector = target.detector()
    false = sum(len(detector.detect(clutter_image(number))) > 0 for number in range(CLUTTER))
    print(f"{target.name:28s} {'clutter':20s} found in {false} of {CLUTTER}", flush=True)


def others(target: Target) -> list[tuple[str, Target, Target]]:
    """Other prints that must be read rightly: their name, the target of the file, and what is printed."""
    if isinstance(target, AprilGrid):
        return [(f"turned {90 * quarters}°", target, turned(target, quarters)) for quarters in (1, 2)]
    if isinstance(target, Charuco):
        even = target.laid_out(target.columns, 2 * (target.rows // 2) + 1, legacy=False)
        return [("older layout", even, even.laid_out(even.columns, even.rows, legacy=True))]
    if isinstance(target, Chessboard):
        counts = ((9, 7), (8, 6))
        boards = [Chessboard.create(f"{wide} × {high}", wide, high, target.spacing) for wide, high in counts]
        return [(f"white {board.name}", board, white_first(board)) for board in boards]
    return []


def turned(target: AprilGrid, quarters: int) -> AprilGrid:
    """A grid whose tags are printed turned by so many quarters within their cells."""

    class Turned(AprilGrid):
        @property
        def tag_bits(self) -> np.ndarray:
            return np.rot90(super().tag_bits, quarters, axes=(1, 2))

    return Turned(*(getattr(target, field.name) for field in fields(AprilGrid) if field.init and not field.kw_only))


def white_first(board: Chessboard) -> Chessboard:
    """The same board with a white square at the top left."""

    class WhiteFirst(Chessboard):
        def artwork(self) -> Artwork:
            wider = Chessboard.create("", self.columns + 1, self.rows, self.spacing).artwork()
            quads = wider.quads - [self.spacing, 0]
            low, high = super().artwork().low, super().artwork().high
            return Artwork(low, high, quads=quads[quads[:, 0, 0] > -1.5 * self.spacing])

    return WhiteFirst(*(getattr(board, field.name) for field in fields(Chessboard) if field.init and not field.kw_only))


def negative(view: EvaluationView) -> EvaluationView:
    """The same view of a board with black and white exchanged."""
    return replace(view, imaging=replace(view.imaging, black=view.imaging.white, white=view.imaging.black))


def photographs(folder: Path, keys: dict) -> None:
    """A folder of photographs: both passes, and the cameras that they give."""
    target = parse_target(keys)
    detector = target.detector()
    images = [cv2.imread(str(path), cv2.IMREAD_GRAYSCALE) for path in sorted((folder / "images").iterdir())]
    detections = [detector.detect(image) for image in images]
    for name in ("first pass", "second pass"):
        views = [(number, found) for number, found in enumerate(detections) if len(found)]
        observations = Observations.create(
            target.object_points,
            np.concatenate([np.full(len(found), number) for number, found in views]),
            np.concatenate([found.point_index for _, found in views]),
            np.concatenate([found.pixels for _, found in views]),
            images[0].shape[::-1],
            image_names=tuple(f"{number:03d}" for number in range(len(images))),
            disc_radius=target.disc_radius,
        )
        result = calibrate(observations)
        print(
            f"{folder.name:28s} {name:11s} {len(observations.pixels)} points in {len(views)} of {len(images)} images,"
            f" RMS {result.rms_px:.3f} px, fx {result.camera.fx:.2f}, fy {result.camera.fy:.2f}",
            flush=True,
        )
        for view, pose in zip(result.view_images, result.camera_from_target, strict=True):
            detections[view] = look_again(detector, images[view], result.camera, pose, detections[view])


if __name__ == "__main__":
    main()
