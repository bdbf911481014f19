"""Saddle corners, where two black and two white quadrants meet: to sub-pixels, and whether one is there at
all.
"""

from __future__ import annotations

import cv2
import numpy as np

WINDOWS = np.array([2, 3, 4, 5, 7, 9, 12])  # half sides, pixels
CRITERIA = (cv2.TERM_CRITERIA_EPS + cv2.TERM_CRITERIA_COUNT, 40, 0.002)
LEAST_CONTRAST = 8.0  # grey values between white and black
# Where a quadrant is looked at, in shares of the clear zone.
_STEPS = np.array([0.25, 0.5, 0.75])
_SIGNS = np.array([[1, 1], [-1, 1], [-1, -1], [1, -1]])


def refine_corners(image: np.ndarray, pixels: np.ndarray, reach: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Move corners (k, 2) onto the saddle point near them (cv2.cornerSubPix).

    reach (k,): how far, in pixels, the pattern around each corner consists of nothing but its four quadrants;
    the window stays inside. Returns the positions (k, 2) and whether each stayed near its start (k,).
    """
    pixels = np.asarray(pixels, dtype=float).reshape(-1, 2)
    refined = pixels.astype(np.float32).reshape(-1, 1, 2)
    height, width = image.shape
    choice = np.clip(np.searchsorted(WINDOWS, 0.6 * reach, side="right") - 1, 0, len(WINDOWS) - 1)
    inside = ((pixels >= 0) & (pixels <= [width - 1, height - 1])).all(axis=1)
    for number in np.unique(choice[inside]):
        chosen = np.flatnonzero(inside & (choice == number))
        window = int(min(WINDOWS[number], (min(height, width) - 6) // 2))
        if window < 1:
            continue
        moved = cv2.cornerSubPix(image, np.ascontiguousarray(refined[chosen]), (window, window), (-1, -1), CRITERIA)
        refined[chosen] = moved.reshape(-1, 1, 2)
    result = refined.reshape(-1, 2).astype(float)
    shift = np.hypot(*(result - pixels).T)
    return result, inside & (shift <= np.maximum(1.0, 0.5 * reach))


def reach_of(axes: np.ndarray) -> np.ndarray:
    """Radius (k,) of the circle inside the clear zone, pixels. axes (k, 2, 2): the zone's half sides as
    columns.
    """
    longest = np.linalg.norm(axes, axis=1).max(axis=1)
    result: np.ndarray = np.abs(np.linalg.det(axes)) / np.maximum(longest, 1e-9)
    return result


def looks_like_corner(image: np.ndarray, pixels: np.ndarray, axes: np.ndarray, bright: np.ndarray) -> np.ndarray:
    """Whether each pixel (k, 2) is surrounded by four quadrants of the right colours, each even in itself
    (k,).

    axes (k, 2, 2): half sides of the zone to look at, pixels, as columns. bright (k,): +1 where the quadrants
    (+, +) and (−, −) are white, −1 where they are black.
    """
    if len(pixels) == 0:
        return np.zeros(0, dtype=bool)
    values, inside = _quadrants(image, pixels, axes)
    level = np.median(values, axis=2)
    even, odd = level[:, 0::2], level[:, 1::2]
    contrast = bright * (even.mean(axis=1) - odd.mean(axis=1))
    uneven = np.maximum(np.abs(even[:, 0] - even[:, 1]), np.abs(odd[:, 0] - odd[:, 1]))
    centred = values - values.mean(axis=(1, 2), keepdims=True)
    spread = np.sqrt((centred**2).mean(axis=(1, 2)))
    correlation = bright * (centred.mean(axis=2) @ [1.0, -1.0, 1.0, -1.0]) / 4
    result: np.ndarray = (
        inside & (contrast > LEAST_CONTRAST) & (uneven < 0.4 * contrast) & (correlation > 0.75 * spread)
    )
    return result


def corner_contrast(image: np.ndarray, pixels: np.ndarray, axes: np.ndarray) -> np.ndarray:
    """Grey values (k,) by which the quadrants (+, +) and (−, −) about pixels (k, 2) are brighter than the other two.

    axes (k, 2, 2): half sides of the zone to look at, pixels, as columns. 0 beside the image.
    """
    values, inside = _quadrants(image, pixels, axes)
    level = np.median(values, axis=2)
    return np.where(inside, level[:, 0::2].mean(axis=1) - level[:, 1::2].mean(axis=1), 0.0)


def _quadrants(image: np.ndarray, pixels: np.ndarray, axes: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Values (k, 4, n) in the quadrants about pixels (k, 2), and whether they all lie in the image (k,)."""
    first, second = (grid.ravel() for grid in np.meshgrid(_STEPS, _STEPS))
    plane = np.concatenate([np.stack([x * first, y * second]) for x, y in _SIGNS], axis=1)
    places = (pixels[:, :, None] + axes @ plane).astype(np.float32)
    values = cv2.remap(image, places[:, 0], places[:, 1], cv2.INTER_LINEAR).astype(float)
    height, width = image.shape
    inside = (places >= 0).all(axis=(1, 2))
    inside &= (places[:, 0] <= width - 1).all(axis=1) & (places[:, 1] <= height - 1).all(axis=1)
    return values.reshape(len(pixels), 4, -1), inside
