"""Squares counted for inner corners show in what the views never show."""

from __future__ import annotations

import numpy as np
import pytest

from fisheye_ep_calib.calibration.assessing.target_findings import largest_lattice, smaller_board
from fisheye_ep_calib.target.base import rectangular_grid
from fisheye_ep_calib.target.boards.circle_grid import CircleGrid


def sightings(columns: int, rows: int, shifts, wide: int, high: int):
    """Which points of a columns × rows file a board of wide × high shows, put at a shift in each view."""
    index = np.arange(columns * rows).reshape(rows, columns)
    parts = [index[y : y + high, x : x + wide].ravel() for x, y in shifts]
    return np.repeat(np.arange(len(parts)), [len(part) for part in parts]), np.concatenate(parts)


@pytest.mark.parametrize(
    "wide, high, said", [(8, 6, "were squares counted"), (8, 7, "is the board smaller"), (9, 6, "is the board smaller")]
)
def test_a_lattice_one_smaller_each_way_is_squares(wide, high, said):
    seen = sightings(9, 7, [(0, 0), (9 - wide, 7 - high), (0, 0)], wide, high)
    told = smaller_board(rectangular_grid(9, 7, 0.02, 0.03), *seen)
    assert said in told and f"no view shows more than {wide} × {high} of the target file's 9 × 7 points" in told
    assert smaller_board(rectangular_grid(9, 7, 0.02, 0.03), *sightings(9, 7, [(0, 0)] * 3, 9, 7)) == ""


def test_an_asymmetric_grid_is_counted_as_its_file_counts_it():
    points = CircleGrid.create("", 4, 11, 0.02, 0.006, asymmetric=True).object_points
    assert largest_lattice(points, *sightings(4, 11, [(0, 0), (0, 2), (1, 0)], 3, 9)) == (4, 11, 3, 9)
    assert largest_lattice(points, *sightings(4, 11, [(0, 0)] * 3, 4, 11)) is None


def test_two_views_tell_nothing_and_one_whole_view_tells_all():
    points = rectangular_grid(9, 7, 0.02, 0.02)
    assert largest_lattice(points, *sightings(9, 7, [(0, 0), (1, 1)], 8, 6)) is None
    image, point = sightings(9, 7, [(0, 0), (1, 1), (0, 1), (1, 0)], 8, 6)
    image, point = np.append(image, [4, 4]), np.append(point, [0, 62])
    assert largest_lattice(points, image, point) is None


def test_a_board_laid_across_is_cut_by_its_file():
    """Its 8 corners do not fit into 7 rows."""
    image, point = sightings(9, 7, [(0, 0), (1, 1), (0, 1)], 8, 6)
    across = sightings(9, 7, [(2, 0)], 6, 7)[1]
    image, point = np.append(image, np.full(len(across), 3)), np.append(point, across)
    assert largest_lattice(rectangular_grid(9, 7, 0.02, 0.02), image, point) == (9, 7, 8, 6)


@pytest.mark.parametrize(
    "wide, high, said", [(8, 6, (9, 7, 8, 6)), (7, 4, (9, 7, 7, 4)), (9, 6, (9, 7, 9, 6)), (9, 7, None)]
)
def test_whatever_lattice_is_smaller_and_seen_whole(wide, high, said):
    points = rectangular_grid(9, 7, 0.02, 0.03)
    image, point = sightings(9, 7, [(0, 0), (1, 1), (1, 0), (0, 1), (0, 0)], wide, high)
    assert largest_lattice(points, image, point) == said
    cut = ~np.isin(point, np.flatnonzero(np.arange(63) % 9 == 4))  # a column is hidden: no view is whole
    assert largest_lattice(points, image[cut], point[cut]) is None
