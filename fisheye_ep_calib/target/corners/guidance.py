"""Corners found where a camera says they are: every target whose features are saddle corners uses this."""

from __future__ import annotations

import numpy as np

from fisheye_ep_calib.camera import FisheyeCamera
from fisheye_ep_calib.target.corners.contrast import stretched
from fisheye_ep_calib.target.corners.measurement import Surroundings, measure_corners
from fisheye_ep_calib.target.corners.refinement import reach_of
from fisheye_ep_calib.target.detection import Detection, check_image
from fisheye_ep_calib.target.expected_features import expect, expect_bend, pose_columns, stays_smooth

USUAL_ERROR = 0.25  # pixels, of a measured corner


def find_guided(
    image: np.ndarray, camera: FisheyeCamera, camera_from_target: np.ndarray, points: np.ndarray, around: Surroundings
) -> Detection:
    """Look for the corners points (n, 3) of a target at a pose (4, 4)."""
    reason = check_image(image)
    if reason:
        return Detection(reason=reason)
    expected = expect(camera, camera_from_target, points, image.shape)
    index = np.flatnonzero(expected.visible)
    if len(index) == 0:
        return Detection(reason="board out of view")
    start, jacobian, around = expected.pixels[index], expected.plane_jacobian[index], around[index]
    bend = expect_bend(camera, camera_from_target, points[index], around.half, image.shape)
    low, high = np.floor(start.min(axis=0)).astype(int), np.ceil(start.max(axis=0)).astype(int) + 1
    image = stretched(image, image[low[1] : high[1], low[0] : high[0]])
    around = around.coloured_as(image, start, jacobian)
    refined, good = measure_corners(image, start, jacobian, bend, around)
    if good.any():
        offset = refined[good] - start[good]
        columns = pose_columns(camera, camera_from_target, points[index[good]])
        common = stays_smooth(points[index[good]], offset, USUAL_ERROR, columns)
        reach = reach_of(around.half[good, None, None] * jacobian[good])
        good[good] = common & (np.hypot(*(offset - np.median(offset, axis=0)).T) < 0.5 * reach)
    if not good.any():
        return Detection(reason="board not found where the camera expects it", rejected=start)
    return Detection(index[good], refined[good], rejected=start[~good])
