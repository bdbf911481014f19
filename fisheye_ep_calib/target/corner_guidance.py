"""Corners found where a camera says they are: every target whose features are saddle corners uses this."""

from __future__ import annotations

import cv2
import numpy as np

from fisheye_ep_calib.target.corner_refinement import refine_corners
from fisheye_ep_calib.target.detection import Detection, check_image
from fisheye_ep_calib.target.guidance import predict

# Where a corner is looked at, in shares of its clear zone: a ring and a half of samples in each quadrant.
_STEPS = np.array([-0.75, -0.45, -0.2, 0.2, 0.45, 0.75])
LEAST_CORRELATION = 0.75
LEAST_CONTRAST = 8.0


def find_guided(
    image: np.ndarray,
    camera,
    camera_from_target: np.ndarray,
    points: np.ndarray,
    clear: np.ndarray,
    bright: np.ndarray,
) -> Detection:
    """Look for the corners points (n, 3) of a target at a pose (4, 4).

    clear (n,): how far around each corner, metres along x and y, the print consists of its four quadrants only.
    bright (n,): +1 where the quadrants +x+y and −x−y are white, −1 where they are black.
    """
    reason = check_image(image)
    if reason:
        return Detection(reason=reason)
    expected = predict(camera, camera_from_target, points, image.shape)
    index = np.flatnonzero(expected.visible)
    if len(index) == 0:
        return Detection(reason="board out of view")
    start, jacobian = expected.pixels[index], expected.plane_jacobian[index]
    reach = reach_of(jacobian, clear[index])
    refined, good = refine_corners(image, start, reach)
    good &= looks_like_corner(image, refined, jacobian, clear[index], bright[index])
    good[good] = _near_prediction(start[good], refined[good], reach[good])
    if not good.any():
        return Detection(reason="board not found where the camera expects it", rejected=start)
    return Detection(index[good], refined[good], rejected=start[~good])


def reach_of(jacobian: np.ndarray, clear: np.ndarray) -> np.ndarray:
    """How many pixels (k,) around each corner show its four quadrants only, from pixels per metre (k, 2, 2)."""
    # The inscribed circle of the parallelogram that the clear square becomes.
    area = np.abs(np.linalg.det(jacobian))
    longest = np.linalg.norm(jacobian, axis=1).max(axis=1)
    return clear * area / np.maximum(longest, 1e-9)


def looks_like_corner(
    image: np.ndarray, pixels: np.ndarray, jacobian: np.ndarray, clear: np.ndarray, bright: np.ndarray
) -> np.ndarray:
    """Whether the image around each pixel (k, 2) correlates with four quadrants of the right colours (k,)."""
    if len(pixels) == 0:
        return np.zeros(0, dtype=bool)
    x, y = np.meshgrid(_STEPS, _STEPS)
    pattern = np.sign(x * y).ravel()
    plane = np.stack([x.ravel(), y.ravel()])
    offset = (clear[:, None, None] * jacobian) @ plane
    places = (pixels[:, :, None] + offset).astype(np.float32)
    values = cv2.remap(image, places[:, 0], places[:, 1], cv2.INTER_LINEAR).astype(float)
    height, width = image.shape
    inside = (places >= 0).all(axis=(1, 2)) & (places[:, 0] < width).all(axis=1) & (places[:, 1] < height).all(axis=1)
    centred = values - values.mean(axis=1, keepdims=True)
    spread = np.sqrt((centred**2).mean(axis=1))
    signed = bright * (centred @ pattern) / len(pattern)
    return inside & (signed > 0.5 * LEAST_CONTRAST) & (signed > LEAST_CORRELATION * spread)


def _near_prediction(expected: np.ndarray, found: np.ndarray, reach: np.ndarray) -> np.ndarray:
    """Whether each corner (k, 2) moved as the others did, within a share of its clear zone."""
    offset = found - expected
    usual = np.median(offset, axis=0)
    away = np.hypot(*(offset - usual).T)
    return away < np.maximum(6 * np.median(away), 0.35 * reach)
