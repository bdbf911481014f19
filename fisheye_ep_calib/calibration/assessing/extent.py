"""Whether a target's file says one column and one row more than the target has: squares counted for inner corners."""

from __future__ import annotations

import numpy as np

_LEAST_VIEWS = 3
_LEAST_SHARE = 0.3  # of the views, that show all of the smaller lattice


def smaller_lattice(points: np.ndarray, image_index: np.ndarray, point_index: np.ndarray) -> tuple[int, ...] | None:
    """Columns and rows of the file, then those that were seen, where these are one fewer each way; else None.

    points (n, 3): metres. image_index, point_index (M,): of the sightings. A board that is one column and one row
    smaller than its file fits it in several places, across too: its labels shift from view to view, but no view ever
    shows more of it, and many show just that.
    """
    grid = np.stack([np.unique(np.round(axis, 6), return_inverse=True)[1] for axis in points[:, :2].T], axis=1)
    columns, rows = (int(count) + 1 for count in grid.max(axis=0))
    if columns * rows != len(points) or min(columns, rows) < 4:
        return None
    views = np.unique(image_index)
    points_of_view = [np.unique(point_index[image_index == view]) for view in views]
    spans = np.sort([np.ptp(grid[part], axis=0) + 1 for part in points_of_view], axis=1)
    if len(views) < _LEAST_VIEWS or (spans > np.sort([columns - 1, rows - 1])).any():
        return None
    whole = sum(len(part) == (columns - 1) * (rows - 1) for part in points_of_view)
    enough = whole >= max(_LEAST_VIEWS, _LEAST_SHARE * len(views))
    return (columns, rows, columns - 1, rows - 1) if enough else None
