"""What the markers in an image say of a target file that does not describe them."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from fisheye_ep_calib.target.markers.aruco import MARKERS, marker_side
from fisheye_ep_calib.target.markers.codebook import Codebook, codebook, read_cells
from fisheye_ep_calib.target.markers.search import Markers, candidate_quads

FEWEST = 4  # markers that mean something
CHANCES = 5.0  # times as many as chance makes of so many squares
BOARD_NOT_FOUND = "board not found"
MIRRORED = "the image is mirrored: its markers can be read in a mirror only"


def why_no_board(image: np.ndarray, markers: Markers, numbers: np.ndarray, book: Codebook, touching: bool) -> str:
    """Why the markers that were seen are not the board's, numbers (k,) of a dictionary, or what else may be there."""
    own = np.unique(markers.number[np.isin(markers.number, numbers)])
    other = np.setdiff1d(markers.number, numbers)
    if len(other) >= FEWEST and len(other) > len(own):
        return _other_numbers(other, numbers)
    if len(own) >= FEWEST:
        return f"{len(own)} markers are seen, but they do not lie as the target file says: check columns and rows"
    return _unknown_markers(image, markers.candidates, book, touching) or BOARD_NOT_FOUND


def _other_numbers(other: np.ndarray, numbers: np.ndarray) -> str:
    low, high = other.min(), other.max()
    key = f"first_tag: {low}" if high - low + 1 == len(numbers) else "its numbers"
    return f"markers {low} to {high} are seen, and the target file has {numbers[0]} to {numbers[-1]}: check {key}"


def _unknown_markers(image: np.ndarray, quads: np.ndarray, book: Codebook, touching: bool) -> str:
    """What squares with a black border, quads (q, 4, 2), are, of which the dictionary knows none; empty where that
    cannot be told. touching: whether they were parted from others at their corners; the other way is tried too.
    """
    others = _other_markers(image, quads, book)
    if others or len(quads) < FEWEST:
        return others
    return _other_markers(image, candidate_quads(image, book, touching=not touching), book)


def _other_markers(image: np.ndarray, quads: np.ndarray, book: Codebook) -> str:
    if read_in_a_mirror(image, quads, book) >= FEWEST:
        return MIRRORED
    description = known_markers(image, quads, (book.border, 3 - book.border))
    return f"markers of {description} are seen, not of {_described(book.name, book.border)}" if description else ""


def known_markers(image: np.ndarray, quads: np.ndarray, borders: Sequence[int]) -> str:
    """Of which dictionary most quadrilaterals (q, 4, 2) are markers, some of them at least; else empty."""
    most, description = FEWEST - 1, ""
    for border in borders:
        for inner, names in _by_side().items():
            cells, framed = read_cells(image, quads, inner, border)
            for name in names if framed.sum() >= FEWEST else ():
                exact = _exactly_known(codebook(name, border, "a marker"), cells[framed])
                if len(exact) > most:
                    most, description = len(exact), _described(_smallest(name, int(exact.max())), border)
    return description


def read_in_a_mirror(image: np.ndarray, quads: np.ndarray, book: Codebook) -> int:
    """How many markers of a dictionary quadrilaterals (q, 4, 2) are, as a mirror shows them."""
    cells, framed = read_cells(image, quads, book.codes.shape[1], book.border)
    number, _, _ = book.match(cells[framed], mirrored=True)
    return len(np.unique(number[number >= 0]))


def _by_side() -> dict[int, list[str]]:
    """OpenCV's dictionaries by the cells along their markers; the largest of those that begin with one another."""
    names: dict[int, list[str]] = {}
    for name in MARKERS:
        side = marker_side(name)
        if side is not None and _smallest(name, MARKERS[name] - 1) == name and not _has_larger(name):
            names.setdefault(side, []).append(name)
    return names


def _family(name: str) -> str:
    """``DICT_5X5_`` of ``DICT_5X5_100``: its larger ones begin with the smaller ones' markers."""
    start, _, count = name.rpartition("_")
    return start + "_" if count.isdigit() else name


def _has_larger(name: str) -> bool:
    return any(_family(other) == _family(name) and MARKERS[other] > MARKERS[name] for other in MARKERS)


def _smallest(name: str, number: int) -> str:
    """The smallest dictionary of the same family that has a marker of this number."""
    return min(
        (other for other in MARKERS if _family(other) == _family(name) and MARKERS[other] > number),
        key=MARKERS.__getitem__,
    )


def _exactly_known(book: Codebook, cells: np.ndarray) -> np.ndarray:
    """The numbers in a dictionary of cells (q, k, k) that have none wrong; none where chance may tell as many."""
    number, _, wrong = book.match(cells)
    exact = np.unique(number[wrong == 0])
    chance = len(cells) * 4 * len(book.codes) / 2.0 ** (book.codes.shape[1] ** 2)
    return exact if len(exact) >= CHANCES * chance else exact[:0]


def _described(name: str, border: int) -> str:
    return name if border == 1 else f"{name} with a border of {border} cells"
