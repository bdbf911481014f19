"""A chessboard; its features are the inner corners."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from fisheye_ep_calib.target.base import Artwork, Target, bounding_board, rectangular_grid
from fisheye_ep_calib.target.detection import Detector
from fisheye_ep_calib.target.schema import Keys


@dataclass(frozen=True, eq=False)
class Chessboard(Target):
    """``rows`` rows of ``columns`` inner corners; (columns + 1) × (rows + 1) squares, the top-left one black.

    spacing: a square's width, row_spacing its height, metres.
    """

    columns: int
    rows: int
    spacing: float
    row_spacing: float

    kind = "chessboard"
    kalibr_kind = "checkerboard"

    @staticmethod
    def from_keys(keys: Keys, name: str) -> Chessboard:
        keys.only(("type", "name", "columns", "rows", "spacing"))
        columns, rows, spacing = keys.count("columns", 2), keys.count("rows", 2), keys.metres("spacing")
        return Chessboard.create(keys.text("name", name), columns, rows, spacing)

    @staticmethod
    def from_kalibr(keys: Keys, name: str) -> Chessboard:
        keys.only(("target_type", "targetCols", "targetRows", "rowSpacingMeters", "colSpacingMeters"))
        columns, rows = keys.count("targetCols", 2), keys.count("targetRows", 2)
        return Chessboard.create(name, columns, rows, keys.metres("colSpacingMeters"), keys.metres("rowSpacingMeters"))

    @staticmethod
    def create(name: str, columns: int, rows: int, spacing: float, row_spacing: float | None = None) -> Chessboard:
        """Inner corners and square size in metres."""
        row_spacing = spacing if row_spacing is None else row_spacing
        points = rectangular_grid(columns, rows, spacing, row_spacing)
        return Chessboard(name, points, None, columns, rows, spacing, row_spacing)

    def detector(self) -> Detector:
        from fisheye_ep_calib.target.corners.chessboard_detector import ChessboardDetector

        return ChessboardDetector(self)

    def artwork(self) -> Artwork:
        step = np.array([self.spacing, self.row_spacing])
        quads = black_squares(self.columns + 1, self.rows + 1, step) - step
        low, high = bounding_board(self.object_points, 1.5 * step)
        return Artwork(low, high, quads=quads)


def black_squares(columns: int, rows: int, step: np.ndarray) -> np.ndarray:
    """The black squares (q, 4, 2) of a board of columns × rows squares, the one at (0, 0) black."""
    column, row = np.meshgrid(np.arange(columns), np.arange(rows))
    black = (column + row) % 2 == 0
    corner = np.stack([column[black], row[black]], axis=-1)[:, None, :]
    result: np.ndarray = (corner + np.array([[0, 0], [1, 0], [1, 1], [0, 1]])) * step
    return result
