"""The picture a user watches while moving the target: what was found, where it has been, what to do next."""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np

from fisheye_ep_calib.target import Detection

LONGEST_SIDE = 1024  # pixels; larger images are reduced
# Blue, green, red.
FOUND, REFUSED, COVERED, WANTED, TEXT = (80, 220, 60), (60, 60, 255), (220, 160, 40), (0, 200, 255), (255, 255, 255)


@dataclass(frozen=True)
class OverlayRequest:
    """covered (n, 2): pixels of the kept views' points. wanted (k, 2): outline of where to hold the target.

    lines: what to write.
    """

    covered: np.ndarray
    wanted: np.ndarray
    lines: tuple[str, ...]


def draw_overlay(image: np.ndarray, detection: Detection, request: OverlayRequest) -> np.ndarray:
    """A picture (h, w, 3) uint8, blue green red, of a grey image (h, w) uint8, reduced where it is large."""
    scale = min(1.0, LONGEST_SIDE / max(image.shape))
    size = (max(1, round(image.shape[1] * scale)), max(1, round(image.shape[0] * scale)))
    picture = cv2.cvtColor(cv2.resize(image, size, interpolation=cv2.INTER_AREA), cv2.COLOR_GRAY2BGR)
    _tint(picture, request.covered, scale)
    for points, colour in ((detection.rejected, REFUSED), (detection.pixels, FOUND)):
        for x, y in _scaled(points, scale):
            cv2.circle(picture, (x, y), 4, colour, 1, cv2.LINE_AA)
    if len(request.wanted):
        outline = np.array(_scaled(request.wanted, scale), np.int32)
        cv2.polylines(picture, [outline], True, WANTED, 2, cv2.LINE_AA)
    banner = picture[: 26 * len(request.lines) + 12 * bool(request.lines)]
    banner[:] = banner // 3
    for number, line in enumerate(request.lines):
        at, ascii_line = (10, 26 + 26 * number), line.replace("°", " deg").replace("×", "x")
        cv2.putText(picture, ascii_line, at, cv2.FONT_HERSHEY_SIMPLEX, 0.55, TEXT, 1, cv2.LINE_AA)
    return picture


def _tint(picture: np.ndarray, covered: np.ndarray, scale: float) -> None:
    """Colour the area around points that kept views have covered."""
    mask = np.zeros(picture.shape[:2], np.uint8)
    radius = max(4, max(mask.shape) // 60)
    for x, y in _scaled(covered, scale):
        cv2.circle(mask, (x, y), radius, 255, -1)
    inside = mask > 0
    picture[inside] = (0.75 * picture[inside] + 0.25 * np.array(COVERED)).astype(np.uint8)


def _scaled(points: np.ndarray, scale: float) -> list[tuple[int, int]]:
    """Pixels of the image as whole pixels of the reduced one; the centre of the top-left pixel is (0, 0)."""
    return [(int(x), int(y)) for x, y in np.round((np.asarray(points) + 0.5) * scale - 0.5).reshape(-1, 2)]
