"""The views' images, small enough for a page: worst views first, as far as a budget of bytes goes."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import cv2
import numpy as np

from fisheye_ep_calib.errors import CalibrationError
from fisheye_ep_calib.report.data import Picture, View

BUDGET = 12_000_000  # bytes of JPEG in one report
_FULL, _SMALL = 2048, 1024  # longest side, px, while half of the budget lasts and after that
_MOST = 48  # pictures a camera
_QUALITY = 78


def with_pictures(
    views: tuple[View, ...], images: list[int], image: Callable[[int], np.ndarray], budget: int = BUDGET
) -> tuple[View, ...]:
    """The views with their pictures. images: number of each view, for which ``image`` gives grey (h, w) uint8.

    An image that can no longer be read leaves its view without a picture.
    """
    pictured, spent = list(views), 0
    for row in sorted(range(len(views)), key=lambda row: -np.nan_to_num(views[row].rms_px, nan=np.inf))[:_MOST]:
        if spent >= budget:
            break
        try:
            picture = picture_of(image(images[row]), _FULL if spent < budget / 2 else _SMALL)
        except CalibrationError:
            continue
        pictured[row] = replace(views[row], picture=picture)
        spent += len(picture.jpeg)
    return tuple(pictured)


def picture_of(grey: np.ndarray, longest: int = _FULL) -> Picture:
    """grey (h, w) uint8, shrunk to at most ``longest`` pixels a side."""
    height, width = grey.shape
    shrink = longest / max(width, height)
    if shrink < 1:
        size = max(round(shrink * width), 1), max(round(shrink * height), 1)
        grey = cv2.resize(grey, size, interpolation=cv2.INTER_AREA)
    _, jpeg = cv2.imencode(".jpg", np.ascontiguousarray(grey), [cv2.IMWRITE_JPEG_QUALITY, _QUALITY])
    return Picture(jpeg.tobytes(), (width, height))
