"""Looking again where a first calibration says the target is: what the first look found stays unless its image
contradicts it.
"""

from __future__ import annotations

import inspect
from dataclasses import replace

import numpy as np

from fisheye_ep_calib.arrays import BoolArray
from fisheye_ep_calib.camera import FisheyeCamera
from fisheye_ep_calib.target.detection import Detection, Detector

MOVED = 1.0  # pixels between both looks: what they measured is not the same
SLACK = 3.0  # a point of the first look may be off its neighbours by so many times what a new one may
SAME_PLACE = 1.0  # pixels
DOUBLED = "found where another point is"
OFF_NEIGHBOURS = "off where the others say they are"


def look_again(
    detector: Detector, image: np.ndarray, camera: FisheyeCamera, camera_from_target: np.ndarray, first: Detection
) -> Detection:
    """The guided look at an image (h, w), and the points of the first one that it neither has nor contradicts.

    camera_from_target (4, 4). The first look as it was where the second one finds nothing.
    """
    from scipy.spatial import cKDTree

    # A detector of another package may be of a time when it was told nothing of the first look.
    told = [first] if len(inspect.signature(detector.detect_guided).parameters) > 3 else []
    again = detector.detect_guided(image, camera, camera_from_target, *told)
    if len(again) == 0:
        return first
    given_up = dict(again.given_up)
    left = ~np.isin(first.point_index, [*again.point_index, *given_up])
    doubled = left.copy()
    doubled[left] = cKDTree(again.pixels).query(first.pixels[left])[0] < SAME_PLACE
    given_up |= dict.fromkeys(first.point_index[doubled].tolist(), DOUBLED)
    kept = left & ~doubled
    index = np.concatenate([again.point_index, first.point_index[kept]])
    order = np.argsort(index)
    pixels = np.concatenate([again.pixels, first.pixels[kept]])[order]
    return replace(
        again, point_index=index[order], pixels=pixels, given_up=given_up, remark=again.remark or first.remark
    )


def places_of(first: Detection | None, index: np.ndarray, expected: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Where to measure points index (k,): where the first look saw them (k, 2), else where they are expected (k, 2);
    and which it saw (k,).
    """
    if first is None or len(first) == 0:
        return expected, np.zeros(len(index), dtype=bool)
    row = np.full(max(int(index.max(initial=0)), int(first.point_index.max())) + 1, -1)
    row[first.point_index] = np.arange(len(first))
    measured: BoolArray = row[index] >= 0
    return np.where(measured[:, None], first.pixels[row[index]], expected), measured


def contradictions(
    index: np.ndarray, before: np.ndarray, measured: np.ndarray, moved: np.ndarray, fits: np.ndarray, unlike: str
) -> dict[int, str]:
    """Which points index (k,) of the first look, before (k,): those that it had, their image contradicts → why.

    measured (k,): it looks there as it should. moved (k,): pixels between both looks. fits (k,): it lies among the
    others. unlike: what to say of one that does not look so.
    """
    reasons = np.select(
        [~measured, moved > MOVED, ~fits], [unlike, f"moved by more than {MOVED:.0f} px", OFF_NEIGHBOURS], ""
    )
    return {int(point): str(why) for point, why in zip(index[before], reasons[before], strict=True) if why}
