"""What the second look at each frame is worth to a live calibration: points a view, and what is known of E(60°).

A session as the node has it, frame by frame: views that show something new are kept, and the camera is calibrated again
after each ten of them. Once without and once with the camera's help in finding the target (live/frame.py).
"""

from __future__ import annotations

import argparse

import cv2
import numpy as np

from fisheye_ep_calib.camera import FisheyeCamera
from fisheye_ep_calib.errors import CalibrationError
from fisheye_ep_calib.live.frame import RawFrame, detect_in_frame
from fisheye_ep_calib.live.outcome import Outcome, calibrate_views
from fisheye_ep_calib.live.view_store import View, observations_of, view_of
from fisheye_ep_calib.planning.detectability import Board
from fisheye_ep_calib.planning.view_selection import is_new
from fisheye_ep_calib.simulation import evaluation_set, laikin_camera, paper_camera
from fisheye_ep_calib.target import Target, load_target

TARGETS = ("circle_grid_11x7", "chessboard_9x6", "charuco_10x7", "aprilgrid_6x5")
CAMERAS = {"traced": laikin_camera, "paper": paper_camera}
STEP = 10  # views between calibrations


def frames(camera, target: Target, count: int) -> list[RawFrame]:
    views = [view for seed in (0, 1) for view in evaluation_set(camera, target, seed)]
    order = np.random.default_rng(0).permutation(len(views))[:count]
    images = [views[number].image(camera, target) for number in order]
    return [RawFrame(str(n), cv2.imencode(".png", image)[1].tobytes(), True) for n, image in enumerate(images)]


def session(shown: list[RawFrame], target: Target, looks: int) -> tuple[list[View], Outcome | None]:
    kept: list[View] = []
    outcome: Outcome | None = None
    size = (0, 0)
    for frame in shown:
        known: FisheyeCamera | None = outcome.camera if outcome is not None and looks == 2 else None
        sighting = detect_in_frame(frame, target, known)
        size = sighting.image_size
        view = view_of(sighting, target) if len(sighting.detection) else None
        if view is None or not is_new(view.signature, [one.signature for one in kept]):
            continue
        kept.append(view)
        if len(kept) % STEP == 0:
            outcome = calibrated(kept, target, size) or outcome
    return kept, calibrated(kept, target, size)


def calibrated(kept: list[View], target: Target, size: tuple[int, int]) -> Outcome | None:
    try:
        return calibrate_views(observations_of(kept, target, size), "ep_even", "front", "", Board.of(target))
    except CalibrationError:
        return None


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--target", nargs="+", default=TARGETS)
    parser.add_argument("--camera", choices=CAMERAS, default="traced")
    parser.add_argument("--frames", type=int, default=60)
    arguments = parser.parse_args()
    cv2.setNumThreads(1)
    print(f"{'target':<20}{'looks':>6}{'views':>7}{'points a view':>15}{'after the tenth':>17}{'± E(60°) mm':>13}")
    for name in arguments.target:
        target = load_target(name)
        shown = frames(CAMERAS[arguments.camera](), target, arguments.frames)
        for looks in (1, 2):
            kept, outcome = session(shown, target, looks)
            points = np.array([len(view.pixels) for view in kept])
            band = np.nan if outcome is None else outcome.pupil_band_mm
            print(
                f"{name:<20}{looks:>6}{len(kept):>7}{points.mean():>15.1f}{points[STEP:].mean():>17.1f}{band:>13.4f}",
                flush=True,
            )


if __name__ == "__main__":
    main()
