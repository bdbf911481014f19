"""Corners found where a camera says they are: every target whose features are saddle corners uses this."""

from __future__ import annotations

import numpy as np

from fisheye_ep_calib.target.corner_refinement import looks_like_corner, reach_of, refine_corners
from fisheye_ep_calib.target.detection import Detection, check_image
from fisheye_ep_calib.target.guidance import predict, predict_bend, stays_smooth
from fisheye_ep_calib.target.saddle_fit import fit_saddles

USUAL_ERROR = 0.25


def find_guided(
    image: np.ndarray,
    camera,
    camera_from_target: np.ndarray,
    points: np.ndarray,
    clear: np.ndarray,
    bright: np.ndarray,
) -> Detection:
    """Look for the corners points (n, 3) of a target at a pose (4, 4).

    clear (n,): how far around each corner, metres along x and y, the print consists of its four quadrants
    only. bright (n,): +1 where the quadrants +x+y and −x−y are white, −1 where they are black.
    """
    reason = check_image(image)
    if reason:
        return Detection(reason=reason)
    expected = predict(camera, camera_from_target, points, image.shape)
    index = np.flatnonzero(expected.visible)
    if len(index) == 0:
        return Detection(reason="board out of view")
    start = expected.pixels[index]
    axes = clear[index, None, None] * expected.plane_jacobian[index]
    reach = reach_of(axes)
    coarse, good = refine_corners(image, start, reach)
    coarse = np.where(good[:, None], coarse, start)
    bend = predict_bend(camera, camera_from_target, points[index], clear[index], image.shape)
    fit = fit_saddles(image, coarse, axes, bend)
    refined = fit.pixels
    good = fit.good(bright[index]) & looks_like_corner(image, refined, axes, bright[index])
    if good.any():
        offset = refined[good] - start[good]
        common = stays_smooth(points[index[good]], offset, USUAL_ERROR)
        good[good] = common & (np.hypot(*(offset - np.median(offset, axis=0)).T) < 0.5 * reach[good])
    if not good.any():
        return Detection(reason="board not found where the camera expects it", rejected=start)
    return Detection(index[good], refined[good], rejected=start[~good])
