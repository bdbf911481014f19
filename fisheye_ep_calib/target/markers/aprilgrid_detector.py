"""Finding Kalibr's AprilGrid: its tags, then every tag corner against the black square that touches it."""

from __future__ import annotations

from typing import Protocol

import numpy as np

from fisheye_ep_calib.target.corners.measurement import Surroundings
from fisheye_ep_calib.target.detection import RowsOfPoints
from fisheye_ep_calib.target.markers.arrangement import Reading
from fisheye_ep_calib.target.markers.aruco import APRILGRID_BORDER, APRILGRID_DICTIONARY
from fisheye_ep_calib.target.markers.board_detector import MarkerBoardDetector
from fisheye_ep_calib.target.markers.codebook import codebook

# OpenCV's first corner is the tag's bottom right as Kalibr prints it; from there clockwise.
KALIBR_ORDER = np.array([1, 0, 3, 2])
TAG_CELLS = 10


class GridOfTags(RowsOfPoints, Protocol):
    """What is looked for (boards/aprilgrid.py): numbers of tags, lengths in metres, the corners of each tag."""

    @property
    def tag_size(self) -> float: ...
    @property
    def tag_gap(self) -> float: ...
    @property
    def first_tag(self) -> int: ...
    @property
    def tag_points(self) -> np.ndarray: ...
    def transposed(self) -> GridOfTags: ...


class AprilGridDetector(MarkerBoardDetector):
    """Its tags may be turned within their cells; its file may have columns and rows, or top and bottom, exchanged."""

    def __init__(self, target: GridOfTags) -> None:
        self.target = target
        points, around = target.object_points[:, :2], _surroundings(target)
        tags = points[target.tag_points]
        readings = [Reading(tags[:, KALIBR_ORDER], around)]
        for quarters in (2, 1, 3):
            remark = f"the tags are turned by {90 * quarters}° within their cells, and were taken so"
            readings.append(Reading(tags[:, np.roll(KALIBR_ORDER, quarters)], around, remark))
        grid = np.arange(len(tags)).reshape(target.rows, target.columns)
        if target.rows > 1:
            fault = "the tags' numbers rise downwards; the target file has the first tag at the bottom left"
            other = tags[grid[::-1].ravel()]
            readings += [Reading(other[:, np.roll(KALIBR_ORDER, turn)], around, fault=fault) for turn in (0, 2)]
        if target.columns != target.rows:
            turned = target.transposed()
            fault = f"the tags fit columns: {target.rows}, rows: {target.columns}; the file has them the other way"
            other = turned.object_points[:, :2][turned.tag_points]
            readings += [Reading(other[:, np.roll(KALIBR_ORDER, turn)], around, fault=fault) for turn in (0, 2)]
        super().__init__(
            target.object_points,
            readings,
            codebook(APRILGRID_DICTIONARY, APRILGRID_BORDER, "an AprilGrid"),
            target.first_tag + np.arange(len(tags)),
            touching=True,
            step=target.tag_size,
            reach=(0.72 * target.tag_size, 1.6 * target.tag_size),
        )


def _surroundings(target: GridOfTags) -> Surroundings:
    """What is printed around the tags' corners."""
    # The quadrants (+, +) and (−, −) hold tag and square at a tag's bottom left and top right corners.
    corner_in_tag = np.zeros(len(target.object_points), dtype=int)
    corner_in_tag[target.tag_points] = np.arange(4)
    bright = np.where(corner_in_tag % 2 == 0, -1.0, 1.0)
    half = np.full(len(bright), 0.95 * target.tag_gap)
    depth = np.repeat(half[:, None], 2, axis=1)
    border = APRILGRID_BORDER / TAG_CELLS * target.tag_size
    if border < half[0]:
        depth[np.arange(len(bright)), np.where(bright < 0, 0, 1)] = border
    return Surroundings(half, bright, depth, np.full(len(bright), target.tag_gap))
