"""Finding square markers: coarse to fine, sharpened where the image is soft, and in the negative."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace

import cv2
import numpy as np

from fisheye_ep_calib.arrays import BoolArray
from fisheye_ep_calib.target.markers.codebook import Codebook, read_cells
from fisheye_ep_calib.target.markers.quads import find_quads

SEARCH_SIDE = 1400  # pixels; a larger image is halved first
SMALLEST_CELL = 1.2  # pixels that a marker's cell needs to be read
ENOUGH = 6  # markers that end the search: the rest of the board is found from them
LARGEST_DOUBLED = 1100  # pixels; a larger image is not doubled to be sharpened
SHARPENING = ((1.5, 1.5), (3.0, 3.0))  # σ, pixels, and amount of the unsharp masks
WORTH_SHARPENING = 10  # squares that look like markers and could not be read; or a marker that was
WORTH_LOOKING_CLOSER = 3  # the same, in the negative
PLAIN = 0.15  # share of the cells that differ from the others: fewer are no marker
SAME_MARKER = 0.3  # of its size: two sightings nearer than this are one


@dataclass(frozen=True)
class Markers:
    """m markers. number (m,): the dictionary's. corners (m, 4, 2): pixels, clockwise from the marker's own top left.

    negative: black and white are exchanged. rejected (r, 2): centres of quadrilaterals that are no known marker.
    candidates (q, 4, 2): the quadrilaterals of a first look, not in the negative.
    """

    number: np.ndarray
    corners: np.ndarray
    negative: bool
    rejected: np.ndarray
    candidates: np.ndarray

    def __len__(self) -> int:
        return len(self.number)

    def __getitem__(self, chosen: np.ndarray) -> Markers:
        return Markers(self.number[chosen], self.corners[chosen], self.negative, self.rejected, self.candidates)


@dataclass(frozen=True)
class Look:
    """How an image is searched: reduced by a factor, or with its edges made steeper."""

    factor: float
    steep: tuple[float, float] | None = None


def find_markers(image: np.ndarray, book: Codebook, numbers: np.ndarray, touching: bool) -> Markers:
    """The markers of a dictionary in an image (h, w) uint8; those of the board, numbers (k,), end the search.

    touching: whether other black squares touch the markers' corners.
    """
    enough = min(ENOUGH, len(numbers))
    markers = _search(image, book, numbers, touching, enough, negative=False)
    if np.isin(markers.number, numbers).sum() >= min(2, enough):
        return markers
    light = _search(cv2.bitwise_not(image), book, numbers, touching, enough, negative=True)
    return replace(light, candidates=markers.candidates) if len(light) > len(markers) else markers


def _search(
    image: np.ndarray, book: Codebook, numbers: np.ndarray, touching: bool, enough: int, negative: bool
) -> Markers:
    number, corners, rejected = np.empty(0, dtype=int), np.empty((0, 4, 2)), np.empty((0, 2))
    candidates: np.ndarray | None = None
    unread = 0
    for look in _looks(image):
        if look.steep is not None and len(number) == 0 and unread < WORTH_SHARPENING:
            break
        seen_as, quads = _quads(image, look, book, touching)
        candidates = quads if candidates is None else candidates
        cells, framed = _cells(image, seen_as, quads, look, book)
        numbers_read, turn, _ = book.match(cells[framed])
        readable = numbers_read >= 0
        middles = quads.mean(axis=1)
        like_markers = _like_markers(quads[framed][~readable], cells[framed][~readable], book)
        unread = max(unread, int(like_markers.sum()))
        rejected = np.concatenate([rejected, middles[~framed], middles[framed][~readable]])
        number = np.concatenate([number, numbers_read[readable]])
        corners = np.concatenate([corners, _from_own_corner(quads[framed][readable], turn[readable])])
        number, corners = _each_once(number, corners)
        if len(np.intersect1d(number, numbers)) >= enough:
            break
        if negative and unread < WORTH_LOOKING_CLOSER and len(number) == 0:
            break
    assert candidates is not None  # there is a look at least
    return Markers(number, corners, negative, rejected, candidates)


def _like_markers(quads: np.ndarray, cells: np.ndarray, book: Codebook) -> np.ndarray:
    """Whether quadrilaterals (q, 4, 2) with a black border may be markers that a closer look would read (q,): large
    enough, and of cells (q, k, k) neither all black nor all white.
    """
    first, second = quads[:, 2] - quads[:, 0], quads[:, 3] - quads[:, 1]
    side = np.sqrt(np.abs(first[:, 0] * second[:, 1] - first[:, 1] * second[:, 0]) / 2)
    white = cells.mean(axis=(1, 2))
    result: BoolArray = (side >= SMALLEST_CELL * book.side) & (white > PLAIN) & (white < 1 - PLAIN)
    return result


def candidate_quads(image: np.ndarray, book: Codebook, touching: bool) -> np.ndarray:
    """What may be markers of any dictionary, quadrilaterals (q, 4, 2), at a first look."""
    return _quads(image, next(_looks(image)), book, touching)[1]


def _looks(image: np.ndarray) -> Iterator[Look]:
    """Coarse to fine, as a smaller image has fewer candidates in its background; then with the blur taken back."""
    longest = max(image.shape)
    if longest > SEARCH_SIDE:
        yield Look(2.0)
    yield Look(1.0)
    for steep in SHARPENING:
        yield Look(0.5 if longest <= LARGEST_DOUBLED else 1.0, steep)


def _quads(image: np.ndarray, look: Look, book: Codebook, touching: bool) -> tuple[np.ndarray, np.ndarray]:
    """The image as it is looked at, and quadrilaterals (q, 4, 2) in pixels of the whole image."""
    factor = look.factor
    if factor > 1:
        height, width = int(image.shape[0] // factor), int(image.shape[1] // factor)
        cropped = image[: int(height * factor), : int(width * factor)]
        image = cv2.resize(cropped, (width, height), interpolation=cv2.INTER_AREA)
    elif factor < 1:
        image = cv2.resize(image, None, fx=1 / factor, fy=1 / factor, interpolation=cv2.INTER_CUBIC)
    elif look.steep is None:
        image = cv2.GaussianBlur(image, (3, 3), 0.8)  # noise has very many outlines
    if look.steep is not None:
        image = _steeper(image, look.steep[0] / factor, look.steep[1])
    quads = find_quads(image, SMALLEST_CELL * book.side / factor, book.border / book.side, touching)
    return image, (quads + 0.5) * factor - 0.5


def _cells(
    image: np.ndarray, seen_as: np.ndarray, quads: np.ndarray, look: Look, book: Codebook
) -> tuple[np.ndarray, np.ndarray]:
    """The cells of quadrilaterals, pixels of the whole image, which tells them best unless it is soft."""
    if look.steep is not None:
        image, quads = seen_as, (quads + 0.5) / look.factor - 0.5
    return read_cells(image, quads, book.codes.shape[1], book.border)


def _steeper(image: np.ndarray, sigma: float, amount: float) -> np.ndarray:
    soft = cv2.GaussianBlur(image, (0, 0), 0.4 * sigma)
    return cv2.addWeighted(soft, 1 + amount, cv2.GaussianBlur(image, (0, 0), sigma), -amount, 0)


def _from_own_corner(quads: np.ndarray, turn: np.ndarray) -> np.ndarray:
    """Quadrilaterals (q, 4, 2) from the markers' own top-left corners on, which are turned by so many quarters (q,)."""
    order = (np.arange(4) + turn[:, None]) % 4
    return np.take_along_axis(quads, order[..., None], axis=1)


def _each_once(number: np.ndarray, corners: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """The markers without earlier sightings of the same ones; two with one number in different places both stay."""
    keep = np.ones(len(number), dtype=bool)
    middles = corners.mean(axis=1)
    size = np.ptp(corners, axis=1).max(axis=1, initial=0.0)
    for index in range(len(number)):
        later = np.arange(index + 1, len(number))
        later = later[number[later] == number[index]]
        near = np.hypot(*(middles[later] - middles[index]).T) < SAME_MARKER * size[index]
        keep[index] = not near.any()
    return number[keep], corners[keep]
