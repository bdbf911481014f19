"""The picture a user watches while moving the target: what was found, where it has been, where to hold it next."""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np

from fisheye_ep_calib.planning.steering import Steering
from fisheye_ep_calib.planning.view_selection import ViewSignature
from fisheye_ep_calib.target import Detection

LONGEST_SIDE = 1024  # pixels; larger images are reduced
JPEG_QUALITY = 80
_COARSE = 4  # pixels of the picture for one of the map of what is covered
_TEXT_SCALE = 0.9 / 1024  # of OpenCV's font, for a pixel of the longest side
# Blue, green, red.
FOUND, REFUSED, COVERED, WANTED, TEXT = (80, 220, 60), (60, 60, 255), (220, 160, 40), (0, 200, 255), (255, 255, 255)
_SHADE = (20, 20, 20)
_SIDES = {"right": (1, 0), "left": (-1, 0), "lower": (0, 1), "upper": (0, -1)}


@dataclass(frozen=True)
class OverlayRequest:
    """covered (n, 2): pixels of the kept views' points. wanted (k, 2): outline of where to hold the target.

    lines: what to write. refused: also show what looked like a feature and was none. signature: of the view that is
    wanted, for arrows. raw, compressed, page: which pictures are wanted.
    """

    covered: np.ndarray
    wanted: np.ndarray
    lines: tuple[str, ...]
    refused: bool = False
    signature: ViewSignature | None = None
    raw: bool = True
    compressed: bool = False
    page: bool = False


@dataclass(frozen=True)
class Pictures:
    """Of one image: raw (h, w, 3) uint8, blue green red; compressed: the same as JPEG; page: JPEG without the lines."""

    raw: np.ndarray | None = None
    compressed: bytes | None = None
    page: bytes | None = None


def draw_pictures(
    image: np.ndarray, detection: Detection, request: OverlayRequest, steering: Steering | None = None
) -> Pictures:
    """Those that are wanted of a grey image (h, w) uint8."""
    picture = draw_overlay(image, detection, request, steering)
    page = _jpeg(picture) if request.page else None
    if request.raw or request.compressed:
        _write_lines(picture, request.lines)
    compressed = _jpeg(picture) if request.compressed else None
    return Pictures(picture if request.raw else None, compressed, page)


def draw_overlay(
    image: np.ndarray, detection: Detection, request: OverlayRequest, steering: Steering | None = None
) -> np.ndarray:
    """A picture (h, w, 3) uint8, blue green red, of a grey image (h, w) uint8, reduced where it is large; no lines."""
    scale = min(1.0, LONGEST_SIDE / max(image.shape))
    size = (max(1, round(image.shape[1] * scale)), max(1, round(image.shape[0] * scale)))
    picture = cv2.cvtColor(cv2.resize(image, size, interpolation=cv2.INTER_AREA), cv2.COLOR_GRAY2BGR)
    unit = max(max(size) / LONGEST_SIDE, 0.2)  # of everything that is drawn
    _tint(picture, request.covered, scale)
    if request.refused:
        _circle(picture, detection.rejected, scale, REFUSED, unit)
    _circle(picture, detection.pixels, scale, FOUND, unit)
    if len(request.wanted):
        outline = np.array(_scaled(request.wanted, scale), np.int32)
        cv2.polylines(picture, [outline], True, _SHADE, max(1, round(7 * unit)), cv2.LINE_AA)
        cv2.polylines(picture, [outline], True, WANTED, max(1, round(4 * unit)), cv2.LINE_AA)
        if steering is not None and len(detection):
            _draw_steering(picture, detection.pixels * scale, request.wanted * scale, steering, unit)
    return picture


def _draw_steering(
    picture: np.ndarray, measured: np.ndarray, wanted: np.ndarray, steering: Steering, unit: float
) -> None:
    """An arrow to where the board is wanted; once there, arrows outwards for nearer, inwards for farther; the side to
    bring nearer as a bar with an arrow towards the one who looks.
    """
    here, there = measured.mean(axis=0), wanted.mean(axis=0)
    reach = 0.5 * float(np.ptp(measured, axis=0).max())
    if steering.move != (0.0, 0.0):
        _arrow(picture, here, there, unit)
    elif steering.nearer:
        for direction in np.array([[1, 1], [1, -1], [-1, 1], [-1, -1]]) / np.sqrt(2):
            ends = here + 0.5 * reach * direction, here + reach * direction
            _arrow(picture, *(ends if steering.nearer > 0 else ends[::-1]), unit)
    elif steering.tip:
        side = np.array(_SIDES[steering.tip], dtype=float)
        across = side[::-1]
        middle = here + reach * side
        start, end = _whole(middle - 0.6 * reach * across), _whole(middle + 0.6 * reach * across)
        for colour, width in ((_SHADE, 12), (WANTED, 8)):
            cv2.line(picture, start, end, colour, max(1, round(width * unit)), cv2.LINE_AA)
        _write(picture, "this side nearer", middle + (12 * unit, -12 * unit), unit)


def _arrow(picture: np.ndarray, start: np.ndarray, end: np.ndarray, unit: float) -> None:
    length = max(float(np.linalg.norm(end - start)), 1.0)
    tip = min(0.5, 28 * unit / length)
    for colour, width in ((_SHADE, 12), (WANTED, 7)):
        ends = _whole(start), _whole(end)
        cv2.arrowedLine(picture, *ends, colour, max(1, round(width * unit)), cv2.LINE_AA, tipLength=tip)


def _write_lines(picture: np.ndarray, lines: tuple[str, ...]) -> None:
    """On a dark banner at the top, as large as the picture lets it be read and the lines fit."""
    if not lines:
        return
    texts = [line.replace("°", " deg").replace("×", "x").replace("σ", "sigma") for line in lines]
    scale = _TEXT_SCALE * max(picture.shape[:2])
    widest = max(cv2.getTextSize(text, cv2.FONT_HERSHEY_SIMPLEX, 1.0, 1)[0][0] for text in texts)
    scale = max(0.3, min(scale, 0.97 * picture.shape[1] / max(widest, 1)))
    step = round(38 * scale)
    banner = picture[: step * len(texts) + step // 2]
    banner[:] = banner // 3
    for number, text in enumerate(texts):
        _write(picture, text, np.array([0.4 * step, step * (number + 0.9)]), scale / 0.9)


def _write(picture: np.ndarray, text: str, place: np.ndarray | tuple[float, float], unit: float) -> None:
    thickness = max(1, round(1.6 * unit))
    cv2.putText(picture, text, _whole(place), cv2.FONT_HERSHEY_SIMPLEX, 0.9 * unit, TEXT, thickness, cv2.LINE_AA)


def _circle(picture: np.ndarray, points: np.ndarray, scale: float, colour: tuple[int, int, int], unit: float) -> None:
    for place in _scaled(points, scale):
        cv2.circle(picture, place, max(2, round(4 * unit)), colour, max(1, round(1.5 * unit)), cv2.LINE_AA)


def _tint(picture: np.ndarray, covered: np.ndarray, scale: float) -> None:
    """Colour the area around points that kept views have covered."""
    if len(covered) == 0:
        return
    height, width = picture.shape[:2]
    coarse = np.zeros((-(-height // _COARSE), -(-width // _COARSE)), np.uint8)
    radius = max(4, max(height, width) // 60) / _COARSE
    for x, y in np.unique(np.round((np.asarray(covered) + 0.5) * scale / _COARSE - 0.5).astype(int), axis=0):
        cv2.circle(coarse, (int(x), int(y)), max(1, round(radius)), 255, -1)
    mask = cv2.resize(coarse, (width, height), interpolation=cv2.INTER_NEAREST)
    tinted = cv2.add(cv2.convertScaleAbs(picture, alpha=0.75), np.array([*(0.25 * part for part in COVERED), 0.0]))
    cv2.copyTo(tinted, mask, picture)


def _jpeg(picture: np.ndarray) -> bytes:
    content: np.ndarray = cv2.imencode(".jpg", picture, [cv2.IMWRITE_JPEG_QUALITY, JPEG_QUALITY])[1]
    return content.tobytes()


def _whole(place: np.ndarray | tuple[float, float]) -> tuple[int, int]:
    """Whole pixels that OpenCV can draw to."""
    x, y = np.clip(np.round(place), -20000, 20000)
    return int(x), int(y)


def _scaled(points: np.ndarray, scale: float) -> list[tuple[int, int]]:
    """Pixels of the image as whole pixels of the reduced one; the centre of the top-left pixel is (0, 0)."""
    return [_whole(place) for place in ((np.asarray(points) + 0.5) * scale - 0.5).reshape(-1, 2)]
