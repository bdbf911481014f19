"""The views' images, small enough for a page: worst views first, as far as a budget of bytes goes."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

import cv2
import numpy as np

from fisheye_ep_calib.errors import CalibrationError
from fisheye_ep_calib.report.data import CameraReport, Picture, View
from fisheye_ep_calib.report.magnification import magnification

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


@dataclass(frozen=True)
class Overlay:
    """Path data: a square on each point, their residuals enlarged, and crosses on what was rejected."""

    points: str
    vectors: str
    rejected: str


def overlays_of(camera: CameraReport) -> tuple[tuple[Overlay, ...], float]:
    """One overlay a view, empty without a picture, and the factor by which residuals are enlarged in all of them."""
    length = np.linalg.norm(camera.residuals.error, axis=-1)
    factor = magnification(length, max(camera.image_size) / 35)
    cross, dot = max(camera.image_size) / 90, round(max(camera.image_size) / 320, 1)
    overlays = []
    for row, view in enumerate(camera.views):
        if view.picture is None:
            overlays.append(Overlay("", "", ""))
            continue
        own = camera.residuals.view == row
        pixels, error = camera.residuals.pixels[own], factor * camera.residuals.error[own]
        wrong = [point.pixel for point in camera.rejected if point.view == view.name]
        overlays.append(
            Overlay(
                "".join(f"M{u - dot / 2:.1f} {v - dot / 2:.1f}h{dot:g}v{dot:g}h-{dot:g}z" for u, v in pixels),
                "".join(f"M{u:.1f} {v:.1f}l{du:.1f} {dv:.1f}" for (u, v), (du, dv) in zip(pixels, error, strict=True)),
                "".join(
                    f"M{u - cross:.1f} {v - cross:.1f}l{2 * cross:.1f} {2 * cross:.1f}m0 {-2 * cross:.1f}"
                    f"l{-2 * cross:.1f} {2 * cross:.1f}"
                    for u, v in wrong
                ),
            )
        )
    return tuple(overlays), factor
