"""Corners found where a camera says they are: every target whose features are saddle corners uses this."""

from __future__ import annotations

import numpy as np

from fisheye_ep_calib.camera import FisheyeCamera
from fisheye_ep_calib.target.corners.contrast import stretched
from fisheye_ep_calib.target.corners.measurement import Surroundings, measure_corners
from fisheye_ep_calib.target.corners.refinement import reach_of
from fisheye_ep_calib.target.detection import Detection, check_image
from fisheye_ep_calib.target.expected_features import expect, expect_bend, pose_columns, stays_smooth
from fisheye_ep_calib.target.second_look import SLACK, contradictions, places_of

USUAL_ERROR = 0.25  # pixels, of a measured corner
NO_CORNER = "blurred or covered"


def find_guided(
    image: np.ndarray,
    camera: FisheyeCamera,
    camera_from_target: np.ndarray,
    points: np.ndarray,
    around: Surroundings,
    first: Detection | None = None,
) -> Detection:
    """Look for the corners points (n, 3) of a target at a pose (4, 4). first: what was found without."""
    reason = check_image(image)
    if reason:
        return Detection(reason=reason)
    expected = expect(camera, camera_from_target, points, image.shape)
    index = np.flatnonzero(expected.visible)
    if len(index) == 0:
        return Detection(reason="board out of view")
    where, jacobian, around = expected.pixels[index], expected.plane_jacobian[index], around[index]
    start, measured_before = places_of(first, index, where)
    bend = expect_bend(camera, camera_from_target, points[index], around.half, image.shape)
    low, high = np.floor(start.min(axis=0)).astype(int), np.ceil(start.max(axis=0)).astype(int) + 1
    image = stretched(image, image[low[1] : high[1], low[0] : high[0]])
    around = around.coloured_as(image, start, jacobian)
    refined, measured = measure_corners(image, start, jacobian, bend, around)
    good = measured.copy()
    if good.any():
        offset = refined[good] - where[good]
        columns = pose_columns(camera, camera_from_target, points[index[good]])
        slack = np.where(measured_before[good], SLACK, 1.0)
        common = stays_smooth(points[index[good]], offset, USUAL_ERROR, columns, slack)
        reach = reach_of(around.half[good, None, None] * jacobian[good])
        good[good] = common & (np.hypot(*(offset - np.median(offset, axis=0)).T) < 0.5 * reach)
    if not good.any():
        return Detection(reason="board not found where the camera expects it", rejected=start)
    given_up = contradictions(index, measured_before, measured, np.hypot(*(refined - start).T), good, NO_CORNER)
    good &= ~np.isin(index, list(given_up))
    return Detection(index[good], refined[good], rejected=start[~good], given_up=given_up)
