"""Square markers by cv2.aruco with settings for strong wide-angle lenses."""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np

from fisheye_ep_calib.target.markers.aruco import require_aruco

SEARCH_SIDE = 1400  # pixels; a larger image is halved first
MOSTLY_FOUND = 0.9  # share of the markers that ends the search
SMALLEST_CELL = 1.4  # pixels that a marker's cell needs to be read
FEW = 6  # markers, below which a sharpened image is searched too
LARGEST_DOUBLED = 1100  # pixels; a larger image is not doubled for that
SHARPENING = ((1.5, 1.5), (3.0, 3.0))  # σ, pixels, and amount of the unsharp masks


@dataclass(frozen=True)
class Markers:
    """place (m,): in the list of the board's numbers. corners (m, 4, 2): pixels, clockwise from the own top left.

    rejected (r, 2): centres of quadrilaterals that are no known marker.
    """

    place: np.ndarray
    corners: np.ndarray
    rejected: np.ndarray


def find_markers(image: np.ndarray, dictionary, border: int, numbers: np.ndarray, what: str) -> Markers:
    """Find a board's markers, numbers (k,) of a dictionary in rising order.

    border: their black cells around. what: for the error message.

    A number that is seen twice is left out: one of the two is not the board's.
    """
    module = require_aruco(what)
    settings = module.DetectorParameters()
    # Large windows see markers that fill much of the image, small ones those at the rim.
    settings.adaptiveThreshWinSizeMin = 5
    settings.adaptiveThreshWinSizeMax = 63
    settings.adaptiveThreshWinSizeStep = 14
    settings.polygonalApproxAccuracyRate = 0.06
    settings.markerBorderBits = border
    settings.perspectiveRemovePixelPerCell = 6
    settings.cornerRefinementMethod = module.CORNER_REFINE_NONE
    cells = dictionary.markerSize + 2 * border
    found: list[tuple[np.ndarray, np.ndarray, np.ndarray]] = []
    for factor in _factors(image):
        # Markers too small to be read are not worth a look; in a textured background there are very many.
        side = max(image.shape) / factor
        settings.minMarkerPerimeterRate = min(4 * SMALLEST_CELL * cells / side, 0.5)
        found.append(_run(module.ArucoDetector(dictionary, settings), image, factor))
        if len(np.intersect1d(found[-1][0], numbers)) >= MOSTLY_FOUND * len(numbers):
            break
    if len(np.unique(np.concatenate([part[0] for part in found]))) < min(FEW, len(numbers)):
        settings.minMarkerPerimeterRate = min(4 * SMALLEST_CELL * cells / max(image.shape), 0.5)
        found += _run_sharpened(module.ArucoDetector(dictionary, settings), image)
    identity, corners, rejected = (np.concatenate(parts) for parts in zip(*found, strict=True))
    keep = np.zeros(len(identity), dtype=bool)
    for number in np.intersect1d(identity, numbers):
        same = np.flatnonzero(identity == number)
        middles = corners[same].mean(axis=1)
        size = np.ptp(corners[same[0]], axis=0).max()
        if np.hypot(*(middles - middles[0]).T).max() < 0.3 * size:
            keep[same[-1]] = True
    place = np.searchsorted(numbers, identity[keep])
    return Markers(place, corners[keep], rejected)


def _factors(image: np.ndarray) -> tuple[int, ...]:
    """Reductions to search at: a smaller image first, where the background has fewer candidates."""
    return (2, 1) if max(image.shape) > SEARCH_SIDE else (1,)


def _run(finder, image: np.ndarray, factor: int) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    small = image
    if factor > 1:
        height, width = image.shape[0] // factor, image.shape[1] // factor
        small = cv2.resize(image[: height * factor, : width * factor], (width, height), interpolation=cv2.INTER_AREA)
    corners, identity, rejected = finder.detectMarkers(small)
    if identity is None or len(corners) == 0:
        identity, corners = np.empty(0, dtype=int), np.empty((0, 4, 2))
    corners = np.asarray(corners, dtype=float).reshape(-1, 4, 2)
    middles = np.asarray(rejected, dtype=float).reshape(-1, 4, 2).mean(axis=1)
    return np.ravel(identity).astype(int), _full_size(corners, factor), _full_size(middles, factor)


def _run_sharpened(finder, image: np.ndarray) -> list[tuple[np.ndarray, np.ndarray, np.ndarray]]:
    """What is found once the blur is taken back: twice as large, where that is no huge image, and steeper."""
    scale = 2 if max(image.shape) <= LARGEST_DOUBLED else 1
    large = cv2.resize(image, None, fx=scale, fy=scale, interpolation=cv2.INTER_CUBIC) if scale > 1 else image
    parts = []
    for sigma, amount in SHARPENING:
        soft = cv2.GaussianBlur(large, (0, 0), 0.4 * sigma * scale)
        steep = cv2.addWeighted(soft, 1 + amount, cv2.GaussianBlur(large, (0, 0), sigma * scale), -amount, 0)
        identity, corners, rejected = _run(finder, steep, 1)
        parts.append((identity, (corners + 0.5) / scale - 0.5, (rejected + 0.5) / scale - 0.5))
    return parts


def _full_size(pixels: np.ndarray, factor: int) -> np.ndarray:
    return (pixels + 0.5) * factor - 0.5
