"""Dark elliptic blobs: what a disc may look like before anything is known about the board."""

from __future__ import annotations

import math
from dataclasses import dataclass

import cv2
import numpy as np
from scipy.spatial import cKDTree

SEARCH_SIDE = 700  # pixels of the longer side of the image that is searched
WINDOWS = (31, 121)  # pixels: adaptive thresholds for small discs and large ones
MOST_BLOBS = 4000  # the largest ones of an image
FITNESS = 0.965  # area of a blob over that of the ellipse of its moments; of small ones less is asked
RING_ANGLES = np.linspace(0, 2 * np.pi, 16, endpoint=False)


@dataclass(frozen=True)
class Blobs:
    """k candidates. center (k, 2): pixels. shape (k, 2, 2): the ellipse x' shape⁻¹ x = 1 about the centre,
    pixels².

    hole (k,): area of a white hole as a share of the disc's, 0 for a full disc. fitness (k,): 1 for a perfect
    ellipse.
    """

    center: np.ndarray
    shape: np.ndarray
    hole: np.ndarray
    fitness: np.ndarray

    def __len__(self) -> int:
        return len(self.center)

    def __getitem__(self, chosen: np.ndarray) -> Blobs:
        return Blobs(self.center[chosen], self.shape[chosen], self.hole[chosen], self.fitness[chosen])

    def scaled(self, factor: float) -> Blobs:
        """The same blobs in an image ``factor`` times as large."""
        center = (self.center + 0.5) * factor - 0.5
        return Blobs(center, self.shape * factor**2, self.hole, self.fitness)


def usual_factor(shape: tuple[int, ...]) -> int:
    """By how much an image (h, w) is reduced where nothing is known of the discs' size."""
    return max(1, math.ceil(max(shape) / SEARCH_SIDE))


def reduced(image: np.ndarray, factor: int) -> np.ndarray:
    """The image at a whole fraction of its size, without the rows and columns left over."""
    if factor == 1:
        return image
    height, width = image.shape[0] // factor, image.shape[1] // factor
    cropped = image[: height * factor, : width * factor]
    return cv2.resize(cropped, (width, height), interpolation=cv2.INTER_AREA)


def find_blobs(image: np.ndarray, windows: tuple[int, ...], holes: bool) -> Blobs:
    """Dark ellipses on lighter ground in a grey image.

    windows: sides in pixels of the boxes whose mean each pixel is compared with; a disc is found where one of
    them is larger than the disc. holes: whether discs may have a white hole.
    """
    offset = max(4.0, 1.5 * _noise(image))
    ellipses = []
    for window in windows:
        window = min(window, (min(image.shape) // 2) * 2 - 1) | 1
        mask = cv2.adaptiveThreshold(
            image, 1, cv2.ADAPTIVE_THRESH_MEAN_C, cv2.THRESH_BINARY_INV, max(window, 3), offset
        )
        ellipses.append(_ellipses(mask, holes))
    blobs = Blobs(*(np.concatenate([getattr(f, name) for f in ellipses]) for name in Blobs.__dataclass_fields__))
    blobs = blobs[_stands_out(image, blobs)]
    return _without_duplicates(blobs)


def _noise(image: np.ndarray) -> float:
    """Standard deviation of the pixel noise, from a second difference on a sample of the image."""
    step = max(1, image.shape[0] // 200)
    rows = image[::step].astype(np.int16)
    second = np.abs(rows[:, :-2] + rows[:, 2:] - 2 * rows[:, 1:-1])
    return float(np.median(second)) * 1.4826 / np.sqrt(6) if second.size else 0.0


def _ellipses(mask: np.ndarray, holes: bool) -> Blobs:
    """The connected components of a mask that are full ellipses, or ellipses with one hole."""
    count, labels, stats, _ = cv2.connectedComponentsWithStats(mask, connectivity=4)
    width, height = stats[:, cv2.CC_STAT_WIDTH], stats[:, cv2.CC_STAT_HEIGHT]
    area = stats[:, cv2.CC_STAT_AREA]
    sized = (area >= 9) & (np.minimum(width, height) >= 3) & (np.maximum(width, height) < 0.4 * max(mask.shape))
    # A bounding box is fullest around an upright ellipse (π/4), emptiest around a slanted thin one.
    sized &= (area > 0.28 * width * height) & (area < 0.95 * width * height + 4)
    sized[0] = False
    chosen = np.flatnonzero(sized)
    if len(chosen) > MOST_BLOBS:
        chosen = chosen[np.argsort(-area[chosen])[:MOST_BLOBS]]
    compact = np.full(count, -1, dtype=np.int32)
    compact[chosen] = np.arange(len(chosen))
    hole_area = np.zeros(len(chosen))
    if holes and len(chosen):
        hole_area = _fill_holes(mask, labels, compact, len(chosen))
    own = compact[labels.ravel()]
    place = np.flatnonzero(own >= 0)
    own = own[place]
    row = place.astype(np.int32) // mask.shape[1]
    return _from_moments(own, place - row * mask.shape[1], row, len(chosen), hole_area)


def _from_moments(own: np.ndarray, x: np.ndarray, y: np.ndarray, count: int, hole_area: np.ndarray) -> Blobs:
    """Ellipses from the moments of the pixels (x, y) that belong to each; bad ones left out."""
    area = np.bincount(own, minlength=count).astype(float)
    safe = np.maximum(area, 1)
    mean_x = np.bincount(own, x, count) / safe
    mean_y = np.bincount(own, y, count) / safe
    dx, dy = x - mean_x[own], y - mean_y[own]
    # A pixel is a square: 1/12 is its own variance.
    xx = np.bincount(own, dx * dx, count) / safe + 1 / 12
    xy = np.bincount(own, dx * dy, count) / safe
    yy = np.bincount(own, dy * dy, count) / safe + 1 / 12
    determinant = np.maximum(xx * yy - xy * xy, 1e-12)
    fitness = area / (4 * np.pi * np.sqrt(determinant))
    covariance = np.stack([np.stack([xx, xy], -1), np.stack([xy, yy], -1)], -2)
    spread = np.sqrt(np.maximum((xx - yy) ** 2 / 4 + xy**2, 0))
    largest = (xx + yy) / 2 + spread
    slender = largest / np.maximum((xx + yy) / 2 - spread, 1e-9) > 7.0**2
    # Few pixels draw an ellipse poorly.
    good = (fitness > FITNESS - 0.6 / np.sqrt(safe)) & (fitness < 1.1) & ~slender & (area > 0)
    hole = hole_area / safe
    return Blobs(np.stack([mean_x, mean_y], -1)[good], 4 * covariance[good], hole[good], fitness[good])


def _fill_holes(mask: np.ndarray, labels: np.ndarray, compact: np.ndarray, count: int) -> np.ndarray:
    """Give holes inside the chosen components to them (changes ``labels``); returns the area (count,) of the
    holes.
    """
    number, white, stats, _ = cv2.connectedComponentsWithStats(1 - mask, connectivity=8)
    area = stats[:, cv2.CC_STAT_AREA]
    small = (area < 0.1 * mask.size) & (stats[:, cv2.CC_STAT_TOP] > 0) & (area >= 2)
    small[0] = False
    place = np.flatnonzero(small[white.ravel()])
    names, first = np.unique(white.ravel()[place], return_index=True)
    # The pixel above a hole's first pixel in raster order is part of what surrounds it.
    around = labels.ravel()[place[first] - mask.shape[1]]
    owner = np.zeros(number, dtype=labels.dtype)
    owner[names] = np.where(compact[around] >= 0, around, 0)
    given = owner[white.ravel()[place]]
    kept = given > 0
    labels.ravel()[place[kept]] = given[kept]
    return np.bincount(compact[given[kept]], minlength=count).astype(float)


def _stands_out(image: np.ndarray, blobs: Blobs) -> np.ndarray:
    """Whether nearly all of a ring around each blob is lighter than the blob itself."""
    if len(blobs) == 0:
        return np.zeros(0, dtype=bool)
    root = np.linalg.cholesky(blobs.shape)
    circle = np.stack([np.cos(RING_ANGLES), np.sin(RING_ANGLES)])
    reach = root @ circle
    length = np.maximum(np.hypot(reach[:, 0], reach[:, 1]), 1e-9)
    outside = np.maximum(1.3, 1 + 1.5 / length)[:, None] * reach
    inside = np.where(blobs.hole > 0.02, 0.75, 0.5)[:, None, None] * reach
    ring, core = _sample(image, blobs.center, outside), _sample(image, blobs.center, inside)
    dark = core.mean(axis=1)
    step = np.median(ring, axis=1) - dark
    lighter = (ring > dark[:, None] + 0.4 * step[:, None]).mean(axis=1)
    result: np.ndarray = (step > 8) & (lighter > 0.8)
    return result


def discs_are_light(image: np.ndarray, center: np.ndarray, shape: np.ndarray) -> bool:
    """Whether most discs at center (k, 2), with ellipses shape (k, 2, 2), are lighter than what is around them."""
    reach = np.linalg.cholesky(shape) @ np.stack([np.cos(RING_ANGLES), np.sin(RING_ANGLES)])
    outside, inside = (np.median(_sample(image, center, share * reach), axis=1) for share in (1.4, 0.7))
    return bool((inside > outside).sum() > (inside < outside).sum())


def _sample(image: np.ndarray, center: np.ndarray, offset: np.ndarray) -> np.ndarray:
    """Values (k, a) at center (k, 2) + offset (k, 2, a), nearest pixel."""
    column = np.clip(np.rint(center[:, 0, None] + offset[:, 0]).astype(int), 0, image.shape[1] - 1)
    row = np.clip(np.rint(center[:, 1, None] + offset[:, 1]).astype(int), 0, image.shape[0] - 1)
    result: np.ndarray = image[row, column].astype(float)
    return result


def _without_duplicates(blobs: Blobs) -> Blobs:
    """Of blobs with nearly the same centre and size, the best ellipse."""
    if len(blobs) < 2:
        return blobs
    minor = np.sqrt(np.maximum(np.linalg.eigvalsh(blobs.shape)[:, 0], 1e-9))
    pairs = cKDTree(blobs.center).query_pairs(0.5 * float(minor.max()), output_type="ndarray")
    distance = np.hypot(*(blobs.center[pairs[:, 0]] - blobs.center[pairs[:, 1]]).T)
    close = distance < 0.5 * np.minimum(minor[pairs[:, 0]], minor[pairs[:, 1]])
    first, second = pairs[close].T
    worse = np.where(blobs.fitness[first] < blobs.fitness[second], first, second)
    keep = np.ones(len(blobs), dtype=bool)
    keep[worse] = False
    return blobs[keep]
