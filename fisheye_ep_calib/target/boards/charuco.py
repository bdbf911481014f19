"""A ChArUco board: a chessboard whose white squares carry markers, so that every corner has a name."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from fisheye_ep_calib.target.base import Artwork, Target, bounding_board, rectangular_grid
from fisheye_ep_calib.target.boards.chessboard import black_squares
from fisheye_ep_calib.target.detection import Detector
from fisheye_ep_calib.target.markers.aruco import MARKERS, aruco_dictionary, bits_as_quads, dictionary_name, marker_bits
from fisheye_ep_calib.target.schema import Keys


@dataclass(frozen=True, eq=False)
class Charuco(Target):
    """``rows`` rows of ``columns`` inner corners, hence (columns + 1) × (rows + 1) squares.

    spacing: a square's side; marker_size: a marker's, metres. dictionary: OpenCV's name. legacy: the layout
    of OpenCV before 4.6, in which a board with an even number of square rows starts with a white square.
    """

    columns: int
    rows: int
    spacing: float
    marker_size: float
    dictionary: str
    legacy: bool

    kind = "charuco"
    least_feature_px = 4.0

    @staticmethod
    def from_keys(keys: Keys, name: str) -> Charuco:
        keys.only(("type", "name", "columns", "rows", "spacing", "marker_size", "dictionary", "legacy"))
        columns, rows = keys.count("columns", 2), keys.count("rows", 2)
        spacing, marker_size = keys.metres("spacing"), keys.metres("marker_size")
        if not 0.2 * spacing <= marker_size < spacing:
            raise keys.fail(
                "marker_size", f"must be smaller than the square's {spacing:g} m (and at least a fifth of it)"
            )
        given = keys.text("dictionary", "DICT_5X5_250")
        dictionary = dictionary_name(given)
        if dictionary is None:
            raise keys.fail("dictionary", f"{given} is unknown; known: {', '.join(MARKERS)}")
        target = Charuco.create(
            keys.text("name", name), columns, rows, spacing, marker_size, dictionary, keys.flag("legacy")
        )
        if len(target.marker_squares) > MARKERS[dictionary]:
            raise keys.fail(
                "dictionary",
                f"{dictionary} has too few markers for {len(target.marker_squares)} white squares",
            )
        return target

    @staticmethod
    def create(
        name: str,
        columns: int,
        rows: int,
        spacing: float,
        marker_size: float,
        dictionary: str,
        legacy: bool = False,
    ) -> Charuco:
        """Inner corners; lengths in metres."""
        points = rectangular_grid(columns, rows, spacing, spacing)
        return Charuco(name, points, None, columns, rows, spacing, marker_size, dictionary, legacy)

    def laid_out(self, columns: int, rows: int, legacy: bool) -> Charuco:
        """The same squares and markers in other numbers, or in OpenCV's other layout."""
        return Charuco.create(self.name, columns, rows, self.spacing, self.marker_size, self.dictionary, legacy)

    @property
    def white_first(self) -> bool:
        """Whether the top-left square is white."""
        return self.legacy and (self.rows + 1) % 2 == 0

    @property
    def marker_squares(self) -> np.ndarray:
        """The white squares (m, 2) int as (column, row), in the order of their markers' numbers."""
        column, row = np.meshgrid(np.arange(self.columns + 1), np.arange(self.rows + 1))
        white = (column + row) % 2 == (0 if self.white_first else 1)
        return np.stack([column[white], row[white]], axis=-1)

    @property
    def tag_corners(self) -> np.ndarray:
        """Top-left corner (m, 2) of each marker, metres, target frame."""
        return (self.marker_squares - 1) * self.spacing + (self.spacing - self.marker_size) / 2

    @property
    def tag_bits(self) -> np.ndarray:
        """Cells (m, k, k) of each marker from its top-left corner, row by row in y, 1 white."""
        dictionary = aruco_dictionary(self.dictionary, "a ChArUco board")
        return marker_bits(dictionary, np.arange(len(self.marker_squares)), border=1)

    @property
    def unmistakable(self) -> bool:
        return True

    @property
    def smallest_feature(self) -> float:
        return self.marker_size / 3  # of which two or three cells of a marker are one

    def detector(self) -> Detector:
        from fisheye_ep_calib.target.markers.charuco_detector import CharucoDetector

        return CharucoDetector(self)

    def artwork(self) -> Artwork:
        step = np.array([self.spacing, self.spacing])
        squares = black_squares(self.columns + 1, self.rows + 1, step) - step
        if self.white_first:
            squares = black_squares(self.columns + 2, self.rows + 1, step)
            squares = squares[squares[:, 0, 0] > 0.5 * self.spacing] - 2 * step * [1, 0.5]
        bits = self.tag_bits
        cell = self.marker_size / bits.shape[1]
        tags = bits_as_quads(bits, self.tag_corners, np.array([cell, 0]), np.array([0, cell]))
        low, high = bounding_board(self.object_points, 1.5 * step)
        return Artwork(low, high, quads=np.concatenate([squares, tags]))
