"""Whether the markers seen lie as a target file says, or in another way that has a name.

A marker's own corners tell where its neighbours should be; a file can be read in several ways, and the one counts that
most neighbours agree with.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components
from scipy.spatial import cKDTree

from fisheye_ep_calib.target.corners.measurement import Surroundings
from fisheye_ep_calib.target.markers.codebook import apply_homographies, from_unit_square

NEIGHBOURS = 6  # of a marker, as the file has them, that are asked
AGREES = 0.35  # of the distance between two markers: how far the other may lie off
FITTING = 0.6  # of the board's markers that are seen, that have to lie as one board
CLEARLY = 1.2  # times as many agreeing neighbours as the file as it is, for another reading of it


@dataclass(frozen=True)
class Reading:
    """A way to read a target file.

    marker_points (k, 4, 2): the corners of its markers, metres, clockwise from a marker's own top left. around: what is
    printed about its features. remark: what is to be told where it is used; empty for the file as it is. fault: why it
    must not be used; empty where it may.
    """

    marker_points: np.ndarray
    around: Surroundings
    remark: str = ""
    fault: str = ""


@dataclass(frozen=True)
class Arrangement:
    """reading: the one that fits, None where none does. chosen (m,) bool: the markers of one board. others: how many
    markers of another board lie in the same way. alike: other readings that nearly as many neighbours agree with, and
    their markers: of an odd number of squares a row, ChArUco's two layouts differ in the rows' ends alone, the rest is
    moved by one column."""

    reading: Reading | None
    chosen: np.ndarray
    others: int = 0
    alike: tuple[tuple[Reading, np.ndarray], ...] = ()


def arrange(place: np.ndarray, corners: np.ndarray, readings: Sequence[Reading]) -> Arrangement:
    """Which markers, place (m,) in the file's list with pixels corners (m, 4, 2), are one board, and how it is read.

    A board of several markers is believed where two of them agree at least.
    """
    nothing = np.zeros(len(place), dtype=bool)
    if len(place) == 0:
        return Arrangement(None, nothing)
    if len(readings[0].marker_points) == 1:
        return Arrangement(readings[0], np.arange(len(place)) == 0)
    agreeing = [_agreeing_pairs(reading.marker_points[place], place, corners) for reading in readings]
    support = np.array([len(pairs) for pairs in agreeing])
    best = int(support.argmax())
    if support[best] < CLEARLY * max(int(support[0]), 1):
        best = 0
    if support[best] == 0:
        return Arrangement(None, nothing)
    chosen, others = _largest_board(place, agreeing[best])
    if len(np.unique(place[chosen])) < FITTING * len(np.unique(place)):
        return Arrangement(None, nothing)
    alike = [
        (reading, _largest_board(place, pairs)[0])
        for number, (reading, pairs) in enumerate(zip(readings, agreeing, strict=True))
        if number != best and not reading.fault and support[best] < CLEARLY * len(pairs)
    ]
    return Arrangement(readings[best], chosen, others, tuple(alike))


def _agreeing_pairs(metres: np.ndarray, place: np.ndarray, corners: np.ndarray) -> np.ndarray:
    """Pairs (p, 2) of markers of which the one lies where the other's corners say; metres (m, 4, 2) by a reading."""
    middles, measured = metres.mean(axis=1), corners.mean(axis=1)
    first, second = _asked(middles, place)
    if len(first) == 0:
        return np.empty((0, 2), dtype=int)
    own = metres[first]
    across, down = own[:, 1] - own[:, 0], own[:, 3] - own[:, 0]
    offset = middles[second] - own[:, 0]
    unit = np.stack([(offset * axis).sum(axis=1) / (axis * axis).sum(axis=1) for axis in (across, down)], axis=1)
    expected = apply_homographies(from_unit_square(corners[first]), unit[:, :1], unit[:, 1:])[:, 0]
    far = np.linalg.norm(expected - measured[first], axis=1)
    agrees = np.linalg.norm(expected - measured[second], axis=1) < AGREES * far
    # The scale that a marker seen at a slant tells may run away: the distance must be the other's measure too.
    real = np.linalg.norm(measured[second] - measured[first], axis=1)
    agrees &= (far < 2 * real) & (real < 2 * far)
    return np.unique(np.sort(np.stack([first[agrees], second[agrees]], axis=1), axis=1), axis=0)


def _asked(middles: np.ndarray, place: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Pairs (p,), (p,) of markers of different places: each with those of its nearest NEIGHBOURS places."""
    places, index = np.unique(place, return_index=True)
    count = min(NEIGHBOURS + 1, len(places))
    _, near = cKDTree(middles[index]).query(middles[index], k=[*range(1, count + 1)])
    asked = np.zeros((len(places), len(places)), dtype=bool)
    asked[np.repeat(np.arange(len(places)), count), near.ravel()] = True
    np.fill_diagonal(asked, False)
    row = np.searchsorted(places, place)
    first, second = np.nonzero(asked[row[:, None], row])
    return first, second


def _largest_board(place: np.ndarray, pairs: np.ndarray) -> tuple[np.ndarray, int]:
    """The markers (m,) bool of the most complete board that agreeing pairs (p, 2) hold together, one of each place; and
    how many the next one has of what the first has too."""
    count = len(place)
    graph = coo_array((np.ones(len(pairs)), (pairs[:, 0], pairs[:, 1])), shape=(count, count))
    _, board = connected_components(graph, directed=False)
    sizes = np.array([len(np.unique(place[board == number])) for number in range(board.max() + 1)])
    first = int(sizes.argmax())
    chosen = board == first
    for again in np.flatnonzero(chosen):
        same = np.flatnonzero(chosen & (place == place[again]))
        if len(same) > 1:  # one of them is no marker of the board: neither is believed
            chosen[same] = False
    twice = [np.isin(place[board == number], place[chosen]).sum() for number in range(len(sizes)) if number != first]
    others = max((int(number) for number in twice), default=0)
    return chosen, others if others >= 2 else 0
