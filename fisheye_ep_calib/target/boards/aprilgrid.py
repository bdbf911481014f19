"""Kalibr's AprilGrid: tags of the family 36h11 with a black square at every tag corner."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from fisheye_ep_calib.target.base import Artwork, Target, bounding_board
from fisheye_ep_calib.target.detection import Detector
from fisheye_ep_calib.target.markers.aruco import (
    APRILGRID_BORDER,
    APRILGRID_DICTIONARY,
    aruco_dictionary,
    bits_as_quads,
    marker_bits,
)
from fisheye_ep_calib.target.schema import Keys

TAGS_IN_FAMILY = 587


@dataclass(frozen=True, eq=False)
class AprilGrid(Target):
    """``rows`` × ``columns`` tags; the features are their outer corners, four a tag.

    Kalibr's frame and order: x to the right, **y up**, z out of the print; tag 0 at the bottom left, numbers
    rising to the right and then up; point (2·rows of corners upwards) row·2·columns + column. tag_size: a
    tag's side with its black border of two cells, tag_gap: the white gap between tags, metres. first_tag: the number
    that tag 0 has in the family; the others follow it.
    """

    columns: int
    rows: int
    tag_size: float
    tag_gap: float
    first_tag: int = 0

    kind = "aprilgrid"
    least_feature_px = 4.0
    kalibr_kind = "aprilgrid"
    y_up = True  # Kalibr's frame

    @staticmethod
    def from_keys(keys: Keys, name: str) -> AprilGrid:
        keys.only(("type", "name", "columns", "rows", "tag_size", "tag_gap", "first_tag"))
        columns, rows = _tags(keys, "columns", "rows")
        first_tag = _first_tag(keys, "first_tag", columns * rows)
        tag_size, tag_gap = keys.metres("tag_size"), keys.metres("tag_gap")
        if not 0.05 * tag_size <= tag_gap <= tag_size:
            raise keys.fail("tag_gap", "must lie between 0.05 and 1 of the tag_size")
        return AprilGrid.create(keys.text("name", name), columns, rows, tag_size, tag_gap, first_tag)

    @staticmethod
    def from_kalibr(keys: Keys, name: str) -> AprilGrid:
        keys.only(("target_type", "tagCols", "tagRows", "tagSize", "tagSpacing", "codeOffset", "first_tag"))
        columns, rows = _tags(keys, "tagCols", "tagRows")
        tag_size, ratio = keys.metres("tagSize"), keys.positive("tagSpacing")
        if not 0.05 <= ratio <= 1:
            raise keys.fail("tagSpacing", f"is the gap as a share of the tag, between 0.05 and 1, not {ratio:g}")
        first_tag = _first_tag(keys, "first_tag" if "first_tag" in keys else "codeOffset", columns * rows)
        return AprilGrid.create(name, columns, rows, tag_size, ratio * tag_size, first_tag)

    @staticmethod
    def create(name: str, columns: int, rows: int, tag_size: float, tag_gap: float, first_tag: int = 0) -> AprilGrid:
        """Numbers of tags; lengths in metres."""
        column, row = np.meshgrid(np.arange(2 * columns), np.arange(2 * rows))
        grid = np.stack([column, row], axis=-1).reshape(-1, 2)
        points = np.zeros((len(grid), 3))
        points[:, :2] = (grid // 2) * (tag_size + tag_gap) + (grid % 2) * tag_size
        return AprilGrid(name, points, None, columns, rows, tag_size, tag_gap, first_tag)

    def transposed(self) -> AprilGrid:
        """With columns and rows exchanged."""
        return AprilGrid.create(self.name, self.rows, self.columns, self.tag_size, self.tag_gap, self.first_tag)

    @property
    def tag_points(self) -> np.ndarray:
        """Point indices (tags, 4): each tag's corners bottom left, bottom right, top right, top left."""
        tag = np.arange(self.rows * self.columns)
        row, column = tag // self.columns, tag % self.columns
        first = 4 * self.columns * row + 2 * column
        result: np.ndarray = first[:, None] + np.array([0, 1, 2 * self.columns + 1, 2 * self.columns])
        return result

    @property
    def tag_corners(self) -> np.ndarray:
        """Bottom-left corner (tags, 2) of each tag, metres, target frame (y up)."""
        return self.object_points[self.tag_points[:, 0], :2]

    @property
    def tag_bits(self) -> np.ndarray:
        """Cells (tags, 10, 10) from each tag's bottom-left corner, row by row in y (upwards), 1 white."""
        dictionary = aruco_dictionary(APRILGRID_DICTIONARY, "an AprilGrid")
        # Kalibr prints the family as its authors draw it; OpenCV holds it turned by 180°.
        turned = marker_bits(dictionary, self.first_tag + np.arange(self.rows * self.columns), APRILGRID_BORDER)
        return turned[:, :, ::-1]

    @property
    def unmistakable(self) -> bool:
        return True

    def detector(self) -> Detector:
        from fisheye_ep_calib.target.markers.aprilgrid_detector import AprilGridDetector

        return AprilGridDetector(self)

    def artwork(self) -> Artwork:
        bits = self.tag_bits
        cell = self.tag_size / bits.shape[1]
        tags = bits_as_quads(bits, self.tag_corners, np.array([cell, 0]), np.array([0, cell]))
        unit = np.array([[0, 0], [1, 0], [1, 1], [0, 1]])
        period = self.tag_size + self.tag_gap
        column, row = np.meshgrid(np.arange(self.columns + 1), np.arange(self.rows + 1))
        place = np.stack([column, row], axis=-1).reshape(-1, 1, 2) * period - self.tag_gap
        squares = place + unit * self.tag_gap
        low, high = bounding_board(self.object_points, 2 * self.tag_gap)
        return Artwork(low, high, quads=np.concatenate([tags, squares]))


def _tags(keys: Keys, columns_key: str, rows_key: str) -> tuple[int, int]:
    columns, rows = keys.count(columns_key, 1), keys.count(rows_key, 1)
    if columns * rows > TAGS_IN_FAMILY:
        raise keys.fail(
            rows_key, f"times {columns_key} is {columns * rows}; the family 36h11 has {TAGS_IN_FAMILY} tags"
        )
    return columns, rows


def _first_tag(keys: Keys, key: str, count: int) -> int:
    """The number of the first of so many tags in the family, 0 where it is not given."""
    return keys.count(key, 0, TAGS_IN_FAMILY - count) if key in keys else 0
