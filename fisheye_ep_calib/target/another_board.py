"""Which of two boards of one kind in an image is taken: the more complete one, of two alike the larger."""

from __future__ import annotations

from dataclasses import replace

import cv2
import numpy as np

from fisheye_ep_calib.target.detection import Detection

MOSTLY_SEEN = 0.5  # share of the target's points that another board must show to be told of
ANOTHER = "another board of the same kind is in view; the more complete one was taken, or the larger"


def chosen_of(first: Detection, other: Detection, count: int) -> Detection:
    """The one that is taken, with a word on the other where that shows much of a target of so many points."""
    if len(other) < MOSTLY_SEEN * count:
        return first
    best = max(first, other, key=lambda detection: (len(detection), outline_area(detection.pixels)))
    return replace(best, remark="; ".join(filter(None, (best.remark, ANOTHER))))


def outline(pixels: np.ndarray) -> np.ndarray:
    """Convex hull (h, 1, 2) float32 of pixels (k, 2)."""
    hull: np.ndarray = cv2.convexHull(pixels.astype(np.float32))
    return hull


def outline_area(pixels: np.ndarray) -> float:
    """Of the convex hull of pixels (k, 2)."""
    return float(cv2.contourArea(outline(pixels)))
