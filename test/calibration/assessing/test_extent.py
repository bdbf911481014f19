"""Squares counted for inner corners show in what the views never show."""

from __future__ import annotations

import numpy as np
import pytest

from fisheye_ep_calib.calibration.assessing.target_findings import largest_lattice, smaller_lattice
from fisheye_ep_calib.target.base import rectangular_grid


def sightings(columns: int, rows: int, shifts, wide: int, high: int):
    """Which points of a columns × rows file a board of wide × high shows, put at a shift in each view."""
    index = np.arange(columns * rows).reshape(rows, columns)
    parts = [index[y : y + high, x : x + wide].ravel() for x, y in shifts]
    return np.repeat(np.arange(len(parts)), [len(part) for part in parts]), np.concatenate(parts)


@pytest.mark.parametrize(
    "wide, high, said", [(8, 6, (9, 7, 8, 6)), (9, 7, None), (8, 7, None), (9, 6, None), (6, 5, None)]
)
def test_only_a_lattice_one_smaller_each_way_is_squares(wide, high, said):
    seen = sightings(9, 7, [(0, 0), (1, 1), (1, 0), (0, 1), (0, 0)], wide, high)
    assert smaller_lattice(rectangular_grid(9, 7, 0.02, 0.03), *seen) == said


def test_two_views_tell_nothing_and_one_whole_view_tells_all():
    points = rectangular_grid(9, 7, 0.02, 0.02)
    assert smaller_lattice(points, *sightings(9, 7, [(0, 0), (1, 1)], 8, 6)) is None
    image, point = sightings(9, 7, [(0, 0), (1, 1), (0, 1), (1, 0)], 8, 6)
    image, point = np.append(image, [4, 4]), np.append(point, [0, 62])
    assert smaller_lattice(points, image, point) is None


def test_a_board_laid_across_is_cut_by_its_file():
    """Its 8 corners do not fit into 7 rows."""
    image, point = sightings(9, 7, [(0, 0), (1, 1), (0, 1)], 8, 6)
    across = sightings(9, 7, [(2, 0)], 6, 7)[1]
    image, point = np.append(image, np.full(len(across), 3)), np.append(point, across)
    assert smaller_lattice(rectangular_grid(9, 7, 0.02, 0.02), image, point) == (9, 7, 8, 6)


@pytest.mark.parametrize(
    "wide, high, said", [(8, 6, (9, 7, 8, 6)), (7, 4, (9, 7, 7, 4)), (9, 6, (9, 7, 9, 6)), (9, 7, None)]
)
def test_whatever_lattice_is_smaller_and_seen_whole(wide, high, said):
    points = rectangular_grid(9, 7, 0.02, 0.03)
    image, point = sightings(9, 7, [(0, 0), (1, 1), (1, 0), (0, 1), (0, 0)], wide, high)
    assert largest_lattice(points, image, point) == said
    cut = ~np.isin(point, np.flatnonzero(np.arange(63) % 9 == 4))  # a column is hidden: no view is whole
    assert largest_lattice(points, image[cut], point[cut]) is None
