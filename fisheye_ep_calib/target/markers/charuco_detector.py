"""Finding a ChArUco board: markers say where its corners are."""

from __future__ import annotations

from typing import Protocol

import numpy as np

from fisheye_ep_calib.target.corners.measurement import Surroundings
from fisheye_ep_calib.target.detection import RowsOfPoints
from fisheye_ep_calib.target.markers.arrangement import Reading
from fisheye_ep_calib.target.markers.board_detector import MarkerBoardDetector
from fisheye_ep_calib.target.markers.codebook import codebook

UNIT = np.array([[0, 0], [1, 0], [1, 1], [0, 1]])


class SquaresWithMarkers(RowsOfPoints, Protocol):
    """What is looked for (boards/charuco.py): lengths in metres, markers and squares counted row by row."""

    @property
    def spacing(self) -> float: ...
    @property
    def marker_size(self) -> float: ...
    @property
    def dictionary(self) -> str: ...
    @property
    def legacy(self) -> bool: ...
    @property
    def white_first(self) -> bool: ...
    @property
    def marker_squares(self) -> np.ndarray: ...
    @property
    def tag_corners(self) -> np.ndarray: ...
    def laid_out(self, columns: int, rows: int, legacy: bool) -> SquaresWithMarkers: ...


class CharucoDetector(MarkerBoardDetector):
    """Its file may have the other layout of OpenCV, or columns and rows exchanged."""

    def __init__(self, target: SquaresWithMarkers) -> None:
        self.target = target
        readings = [_reading(target)]
        if target.rows % 2 == 1:  # an even number of square rows: the two layouts differ
            remark = f"the markers fit legacy: {str(not target.legacy).lower()}, and were taken so"
            readings.append(_reading(target.laid_out(target.columns, target.rows, not target.legacy), remark))
        if target.columns != target.rows:
            columns, rows = target.rows, target.columns
            fault = f"the markers fit columns: {columns}, rows: {rows}; the file has them the other way"
            for legacy in (target.legacy, not target.legacy):
                turned = target.laid_out(columns, rows, legacy)
                if len(turned.marker_squares) >= len(target.marker_squares):
                    readings.append(_reading(turned, fault=fault))
        super().__init__(
            target.object_points,
            readings,
            codebook(target.dictionary, 1, "a ChArUco board"),
            np.arange(len(target.marker_squares)),
            touching=False,
            step=target.spacing,
            reach=(0.8 * target.spacing, 1.7 * target.spacing),
        )


def _reading(target: SquaresWithMarkers, remark: str = "", fault: str = "") -> Reading:
    points = target.object_points[:, :2]
    parity = np.rint(points / target.spacing).astype(int).sum(axis=1) % 2
    # The square down and right of corner (column, row) is black where column + row is even, unless white is first.
    bright = np.where((parity == 0) != target.white_first, -1.0, 1.0)
    half = np.full(len(bright), 0.5 * target.spacing)
    depth = np.repeat(half[:, None], 2, axis=1)
    depth[np.arange(len(bright)), np.where(bright > 0, 0, 1)] = (target.spacing - target.marker_size) / 2
    marker_points = target.tag_corners[:, None] + target.marker_size * UNIT
    return Reading(marker_points, Surroundings(half, bright, depth, 2 * half), remark, fault)
