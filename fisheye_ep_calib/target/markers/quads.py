"""Black quadrilaterals in an image: what a square marker may look like before it is read.

Each pixel is compared with the middle of the darkest and the brightest one around it, as in AprilTag 2 (Wang and Olson,
IROS 2016). Only what lies near an edge counts as white, so every marker is a hole in a white ring.
"""

from __future__ import annotations

from collections.abc import Sequence

import cv2
import numpy as np

from fisheye_ep_calib.arrays import FloatArray, Image

REACH = 13  # pixels: side of the square in which the darkest and the brightest pixel are taken
LEAST_RANGE = 8.0  # grey values between them, and times the noise
NOISES = 8.0
PARTING = 0.27  # of the range: where black squares touch, blur leaves the middle of it between them
FULLEST, SQUAREST = 0.8, 0.8  # area of a contour over its hull's, and of the quadrilateral over the hull's
CORNERS = (0.03, 0.05, 0.08)  # of the hull's length: how far a corner may be off when the outline is straightened
ROUNDS = 2  # of moving a quadrilateral's sides onto edges
FARTHEST = 4.0  # pixels that a side moves
ALONG = np.linspace(0.15, 0.85, 8)  # of a side: where its edge is looked for
ACROSS = np.linspace(-1.0, 1.0, 13)  # of the way that it may move
LEAST_BLACK, LEAST_FULL = 0.3, 0.12  # of a marker's square, and of the box around it, that is black
LARGEST = 0.9  # of the image's longer side
MOST_QUADS = 4000  # the largest ones


def find_quads(image: np.ndarray, smallest: float, border: float, touching: bool) -> np.ndarray:
    """Black quadrilaterals (q, 4, 2), pixels, clockwise as one looks at the image (h, w) uint8.

    smallest: side, pixels. border: share of a side that is black before white cells may begin. touching: whether other
    black squares touch their corners.
    """
    white = _white(image, PARTING if touching else 0.5)
    contours = _outlines(white, smallest)
    quads = [quad for contour in contours if (quad := _quadrilateral(contour)) is not None]
    if not quads:
        return np.empty((0, 4, 2))
    # The outline runs through the outermost black pixels' middles.
    return _refined(image, _grown(np.array(quads, dtype=float), 0.5), border)


def _outlines(white: np.ndarray, smallest: float) -> Sequence[np.ndarray]:
    """Outlines of what may be a square of at least that side, pixels, in a mask (h, w)."""
    count, label, stats, _ = cv2.connectedComponentsWithStats(cv2.bitwise_not(white), connectivity=4)
    area = stats[:, cv2.CC_STAT_AREA]
    box = stats[:, cv2.CC_STAT_WIDTH].astype(float) * stats[:, cv2.CC_STAT_HEIGHT]
    longest = LARGEST * max(white.shape)
    # White cells are no part of it, and a square that stands on its corner fills half of its box.
    sized = (area >= LEAST_BLACK * smallest**2) & (area <= longest**2) & (area > LEAST_FULL * box)
    sized[0] = False
    chosen = np.flatnonzero(sized)
    sized[chosen[np.argsort(-area[chosen])[MOST_QUADS:]]] = False
    mask = sized.astype(np.uint8)[label]
    contours, tree = cv2.findContours(mask, cv2.RETR_CCOMP, cv2.CHAIN_APPROX_SIMPLE)
    return [contour for contour, entry in zip(contours, tree[0], strict=True) if entry[3] < 0] if contours else []


def _white(image: np.ndarray, level: float) -> np.ndarray:
    """Mask (h, w) uint8 of the pixels near an edge that are brighter than a level between the darkest and the brightest
    one of their surroundings, 0 and 1."""
    square = np.ones((REACH, REACH), np.uint8)
    low, high = cv2.erode(image, square), cv2.dilate(image, square)
    least = max(LEAST_RANGE, NOISES * _noise(image))
    spread = cv2.subtract(high, low)
    middle = cv2.addWeighted(low, 1 - level, high, level, 0)
    mask: Image = np.where((image > middle) & (spread >= least), np.uint8(255), np.uint8(0))
    return mask


def _noise(image: np.ndarray) -> float:
    """Standard deviation of the pixel noise, from a second difference on a sample of rows."""
    rows = image[:: max(1, image.shape[0] // 100)].astype(np.int16)
    second = np.abs(rows[:, :-2] + rows[:, 2:] - 2 * rows[:, 1:-1])
    return float(np.median(second)) * 1.4826 / np.sqrt(6) if second.size else 0.0


def _quadrilateral(contour: np.ndarray) -> np.ndarray | None:
    """The four corners (4, 2) of a contour that is a convex quadrilateral, clockwise; else None."""
    area = cv2.contourArea(contour)
    hull = cv2.convexHull(contour)
    full = cv2.contourArea(hull)
    if len(hull) < 4 or area < FULLEST * full:
        return None
    length = cv2.arcLength(hull, True)
    for share in CORNERS:
        corners = cv2.approxPolyDP(hull, share * length, True)
        if len(corners) == 4:
            return _clockwise(corners[:, 0]) if cv2.contourArea(corners) > SQUAREST * full else None
        if len(corners) < 4:
            return None
    return None


def _refined(image: np.ndarray, quads: np.ndarray, border: float) -> np.ndarray:
    """Quadrilaterals (q, 4, 2), clockwise, with their sides on the edges of the image near them.

    A blurred square's outline is round at its corners, and off by a pixel or two, which a small marker's cells do not
    stand. So each side is the line through the steepest places along some of its normals, and corners are where sides
    meet. border: how much of a side is black before white cells may begin.
    """
    for _ in range(ROUNDS):
        along = np.roll(quads, -1, axis=1) - quads
        length = np.maximum(np.linalg.norm(along, axis=2), 1e-6)
        along = along / length[..., None]
        outwards = np.stack([along[..., 1], -along[..., 0]], axis=-1)
        reach = np.clip(0.8 * border * length, 1.5, FARTHEST)
        steps = reach[..., None] * ACROSS
        on_side = quads[:, :, None] + (length[..., None] * ALONG)[..., None] * along[:, :, None]
        places = on_side[:, :, :, None] + (steps[:, :, None, :, None] * outwards[:, :, None, None])
        places = places.astype(np.float32).reshape(len(quads), -1, 2)
        values = cv2.remap(image, places[..., 0], places[..., 1], cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE)
        values = values.astype(np.float32).reshape(len(quads), 4, len(ALONG), len(ACROSS))
        rise = np.maximum(np.diff(values, axis=3), 0) ** 2
        middle = (steps[..., 1:] + steps[..., :-1]) / 2
        weight = rise.sum(axis=3)
        edge = (rise * middle[:, :, None]).sum(axis=3) / np.maximum(weight, 1e-6)
        # A line e = m + n t through the edge's places, t along the side.
        weight = np.minimum(weight, np.median(weight, axis=2, keepdims=True)) + 1e-6
        total = weight.sum(axis=2)
        mean_t, mean_e = (weight * ALONG).sum(axis=2) / total, (weight * edge).sum(axis=2) / total
        spread = (weight * (ALONG - mean_t[..., None]) ** 2).sum(axis=2)
        slope = (weight * (ALONG - mean_t[..., None]) * (edge - mean_e[..., None])).sum(axis=2) / spread
        start, end = ((mean_e + slope * (t - mean_t))[..., None] * outwards for t in (0, 1))
        quads = _meeting(quads + start, np.roll(quads, -1, axis=1) + end)
    return quads


def _meeting(start: np.ndarray, end: np.ndarray) -> np.ndarray:
    """Where the lines from start to end, (q, 4, 2) each, meet those before them, (q, 4, 2)."""
    direction, before = end - start, np.roll(end - start, 1, axis=1)
    offset = start - np.roll(start, 1, axis=1)
    cross = before[..., 0] * direction[..., 1] - before[..., 1] * direction[..., 0]
    cross = np.where(np.abs(cross) < 1e-6, 1e-6, cross)
    share = (offset[..., 0] * direction[..., 1] - offset[..., 1] * direction[..., 0]) / cross
    corners: FloatArray = np.roll(start, 1, axis=1) + share[..., None] * before
    return corners


def _clockwise(corners: np.ndarray) -> np.ndarray:
    following = np.roll(corners, -1, axis=0)
    turns = float((corners[:, 0] * following[:, 1] - corners[:, 1] * following[:, 0]).sum())
    return corners if turns > 0 else corners[::-1]


def _grown(quads: np.ndarray, by: float) -> np.ndarray:
    """Quadrilaterals (q, 4, 2), clockwise, with every side moved outwards by ``by`` pixels.

    Two sides with unit directions d, e meet at a corner that moves by (d − e) by / (d × e).
    """
    before, after = quads - np.roll(quads, 1, axis=1), np.roll(quads, -1, axis=1) - quads
    before /= np.maximum(np.linalg.norm(before, axis=2, keepdims=True), 1e-9)
    after /= np.maximum(np.linalg.norm(after, axis=2, keepdims=True), 1e-9)
    sine = before[..., 0] * after[..., 1] - before[..., 1] * after[..., 0]
    grown: FloatArray = quads + by * (before - after) / np.maximum(sine, 0.2)[..., None]
    return grown
