"""What a target's print looks like from a point in its plane: the Artwork, made quick to sample.

A pattern answers two questions about points (x, y), metres in the target frame: is the print white there, and
does an edge pass nearby. The second tells the renderer which pixels need more than one sample.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache

import numpy as np

from fisheye_ep_calib.arrays import BoolArray, FloatArray
from fisheye_ep_calib.errors import InputError
from fisheye_ep_calib.target import Artwork, Target

_SAME_EDGE = 1e-9  # metres: edges closer than this are one


@dataclass(frozen=True)
class Discs:
    """Black discs, some with a white hole.

    centers (n, 2), radii (n,), hole_radii (n,) (0 for a full disc): metres. nearest (rows, columns) int32:
    raster, of square cells from origin (2,), of the nearest disc. It replaces a search, and can only be
    wrong halfway between two discs, where no edge is.
    """

    centers: np.ndarray
    radii: np.ndarray
    hole_radii: np.ndarray
    origin: np.ndarray
    cell: float
    nearest: np.ndarray

    @staticmethod
    def create(artwork: Artwork) -> Discs:
        from scipy.spatial import cKDTree

        centers, radii = artwork.discs[:, :2], artwork.discs[:, 2]
        tree = cKDTree(centers)
        gap = np.inf
        if len(centers) > 1:
            distance, other = tree.query(centers, k=2)
            gap = (distance[:, 1] - radii - radii[other[:, 1]]).min()
        if gap <= 0:
            raise InputError("discs of the target overlap")
        hole_radii = np.zeros(len(centers))
        if len(artwork.holes):
            hole_radii[tree.query(artwork.holes[:, :2])[1]] = artwork.holes[:, 2]
        cell = float(np.clip(gap / 4, radii.min() / 20, radii.min()))
        columns, rows = np.ceil((artwork.high - artwork.low) / cell).astype(int) + 1
        x, y = np.meshgrid((np.arange(columns) + 0.5) * cell, (np.arange(rows) + 0.5) * cell)
        nearest = tree.query(np.stack([x, y], axis=-1) + artwork.low)[1].astype(np.int32)
        return Discs(centers, radii, hole_radii, artwork.low, cell, nearest)

    def _distance(self, x: np.ndarray, y: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Distance to the nearest disc's centre, its radius and its hole's radius."""
        rows, columns = self.nearest.shape
        column = np.clip(((x - self.origin[0]) / self.cell).astype(np.int32), 0, columns - 1)
        row = np.clip(((y - self.origin[1]) / self.cell).astype(np.int32), 0, rows - 1)
        disc = self.nearest[row, column]
        parts = (self.centers[:, 0], self.centers[:, 1], self.radii, self.hole_radii)
        center_x, center_y, radius, hole = (part.astype(x.dtype)[disc] for part in parts)
        return np.hypot(x - center_x, y - center_y), radius, hole

    def black(self, x: np.ndarray, y: np.ndarray) -> np.ndarray:
        distance, radius, hole = self._distance(x, y)
        return (distance < radius) & (distance >= hole)

    def has_edge(self, x: np.ndarray, y: np.ndarray, reach_x: np.ndarray, reach_y: np.ndarray) -> BoolArray:
        distance, radius, hole = self._distance(x, y)
        reach = np.hypot(reach_x, reach_y)
        result: BoolArray = (np.abs(distance - radius) < reach) | ((hole > 0) & (np.abs(distance - hole) < reach))
        return result


@dataclass(frozen=True)
class Squares:
    """Black axis-parallel rectangles: chessboard squares and the cells of tags.

    All their edges together make a grid of unequal cells, each wholly black or wholly white.
    edges_x (a,), edges_y (b,): sorted, metres. cells (b + 1, a + 1) bool: black; cell i lies before edge i.
    sums (b + 2, a + 2) int: summed-area table of cells.
    """

    edges_x: np.ndarray
    edges_y: np.ndarray
    cells: np.ndarray
    sums: np.ndarray

    @staticmethod
    def create(artwork: Artwork) -> Squares:
        low, high = artwork.quads.min(axis=1), artwork.quads.max(axis=1)
        upright = np.isclose(artwork.quads, low[:, None], rtol=0, atol=_SAME_EDGE)
        upright |= np.isclose(artwork.quads, high[:, None], rtol=0, atol=_SAME_EDGE)
        if not upright.all():
            raise InputError("only axis-parallel rectangles can be drawn")
        edges_x, edges_y = (_distinct(np.concatenate([low[:, i], high[:, i]])) for i in (0, 1))
        cells = np.zeros((len(edges_y) + 1, len(edges_x) + 1), bool)
        left, right = (np.searchsorted(edges_x, side[:, 0] + _SAME_EDGE, "right") for side in (low, high))
        top, bottom = (np.searchsorted(edges_y, side[:, 1] + _SAME_EDGE, "right") for side in (low, high))
        for x0, x1, y0, y1 in zip(left, right, top, bottom, strict=True):
            cells[y0:y1, x0:x1] = True
        sums = np.zeros((cells.shape[0] + 1, cells.shape[1] + 1), np.int32)
        sums[1:, 1:] = cells.cumsum(axis=0).cumsum(axis=1)
        return Squares(edges_x, edges_y, cells, sums)

    def black(self, x: np.ndarray, y: np.ndarray) -> np.ndarray:
        row = np.searchsorted(self.edges_y.astype(y.dtype), y, "right")
        return self.cells[row, np.searchsorted(self.edges_x.astype(x.dtype), x, "right")]

    def has_edge(self, x: np.ndarray, y: np.ndarray, reach_x: np.ndarray, reach_y: np.ndarray) -> BoolArray:
        left, right = (np.searchsorted(self.edges_x, side, "right") for side in (x - reach_x, x + reach_x))
        top, bottom = (np.searchsorted(self.edges_y, side, "right") for side in (y - reach_y, y + reach_y))
        right, bottom = right + 1, bottom + 1
        sums = self.sums
        black = sums[bottom, right] - sums[top, right] - sums[bottom, left] + sums[top, left]
        result: BoolArray = (black > 0) & (black < (right - left) * (bottom - top))
        return result


def _distinct(values: FloatArray) -> FloatArray:
    """Sorted values with near-duplicates merged."""
    values = np.sort(values)
    result: FloatArray = values[np.concatenate([[True], np.diff(values) > _SAME_EDGE])]
    return result


@dataclass(frozen=True)
class Pattern:
    """A white board with black prints on it, in the plane z = 0 of the target frame.

    low, high (2,): corners of the board, metres. faces: +1 where the print looks along +z, −1 along −z.
    """

    low: np.ndarray
    high: np.ndarray
    faces: int
    prints: tuple[Discs | Squares, ...]

    def on_board(self, x: np.ndarray, y: np.ndarray) -> BoolArray:
        result: BoolArray = (x > self.low[0]) & (x < self.high[0]) & (y > self.low[1]) & (y < self.high[1])
        return result

    def white(self, x: np.ndarray, y: np.ndarray) -> np.ndarray:
        """Whether points (x, y), metres, are white."""
        white = np.ones(x.shape, bool)
        for print_ in self.prints:
            white &= ~print_.black(x, y)
        return white

    def has_edge(self, x: np.ndarray, y: np.ndarray, reach_x: np.ndarray, reach_y: np.ndarray) -> BoolArray:
        """Whether an edge can pass within (reach_x, reach_y), metres, of points (x, y)."""
        edge = (np.abs(x - self.low[0]) < reach_x) | (np.abs(x - self.high[0]) < reach_x)
        edge |= (np.abs(y - self.low[1]) < reach_y) | (np.abs(y - self.high[1]) < reach_y)
        for print_ in self.prints:
            edge |= print_.has_edge(x, y, reach_x, reach_y)
        return np.asarray(edge)


@lru_cache(maxsize=8)
def pattern(target: Target) -> Pattern:
    """The printed pattern of a target."""
    artwork = target.artwork()
    prints: list[Discs | Squares] = []
    if len(artwork.quads):
        prints.append(Squares.create(artwork))
    if len(artwork.discs):
        prints.append(Discs.create(artwork))
    return Pattern(artwork.low, artwork.high, printed_side(target), tuple(prints))


def printed_side(target: Target) -> int:
    """+1 where the print looks along the target's +z (x right, y up), −1 where along −z (x right, y down)."""
    return 1 if target.y_up else -1
