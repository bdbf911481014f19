"""What a calibration says of the target that it was shown: its shape, its file's lengths and its file's counts."""

from __future__ import annotations

import numpy as np

from fisheye_ep_calib.calibration.assessing.finding import Finding
from fisheye_ep_calib.calibration.estimating.fit import Fit
from fisheye_ep_calib.camera import FisheyeCamera
from fisheye_ep_calib.target.shape.measured import BoardShape

_LEAST_VIEWS = 3
_LEAST_SHARE = 0.3  # of the views, that show all of the smaller lattice
_FARTHEST_M, _LARGEST_PUPIL_M = 20.0, 0.05  # beyond which a length's unit is doubted
_ASPECT_SIGMAS, _LEAST_ASPECT = 4.0, 0.02  # σ and %: a smaller difference between a board's scales is not told


def board_bent(board: BoardShape) -> Finding:
    """That it is bent limits nothing where its shape was estimated, but a stiff board would need no estimate."""
    values = {"height_rms_mm": board.height_rms_mm, "height_mm": board.bow_mm, "scatter_mm": board.rough_rms_mm}
    if not board.bent:
        return Finding("board_bent", values, False, "the views say nothing of a bend in the board")
    return Finding(
        "board_bent",
        values,
        True,
        f"the board is bent by {board.bow_mm:.2f} mm from its lowest to its highest point; its shape has been "
        "estimated, but glue it to glass or an aluminium plate to be sure that it keeps it",
    )


def board_scale(board: BoardShape) -> Finding:
    """Printers feed paper faster or slower than they should: x against y; the size of the whole cannot be seen."""
    aspect, sigma = board.aspect_percent, board.aspect_sigma_percent
    values = {"aspect_percent": aspect, "sigma_percent": sigma}
    if abs(aspect) < max(_ASPECT_SIGMAS * sigma, _LEAST_ASPECT):
        return Finding("board_scale", values, False, "the board is as long against its width as its file says")
    longer, shorter = ("x", "y") if aspect > 0 else ("y", "x")
    return Finding(
        "board_scale",
        values,
        True,
        f"against its file the paper is {abs(aspect):.2f} % longer in {longer} than in {shorter}; the calibration has "
        "allowed for that, but cannot see the size of the whole: measure the print and put its size into the target's "
        "file",
    )


def squares_counted(fit: Fit) -> list[Finding]:
    observations = fit.sightings.observations
    seen = observations.object_points, observations.image_index, observations.point_index
    lattice = largest_lattice(*seen)
    if lattice is None:
        return []
    columns, rows = lattice[:2]
    values = {"columns": float(columns), "rows": float(rows)}
    return [Finding("squares_counted", values, True, smaller_board(*seen))]


def smaller_board(points: np.ndarray, image_index: np.ndarray, point_index: np.ndarray) -> str:
    """What to say of a board that is smaller than its file, as ``largest_lattice`` has it; empty where it is not."""
    lattice = largest_lattice(points, image_index, point_index)
    if lattice is None:
        return ""
    columns, rows, most_columns, most_rows = lattice
    one_fewer = (most_columns, most_rows) == (columns - 1, rows - 1)
    question = (
        "were squares counted instead of inner corners" if one_fewer else "is the board smaller, or part of it hidden"
    )
    return (
        f"no view shows more than {most_columns} × {most_rows} of the target file's {columns} × {rows} points:"
        f" {question}? The points of a smaller board are named differently from view to view"
    )


def units(distance: np.ndarray, camera: FisheyeCamera) -> list[Finding]:
    """Distances (M,) and a pupil, metres, that no target and no lens have."""
    far = float(np.median(distance))
    shift = float(np.abs(camera.entrance_pupil(np.linspace(0, camera.theta_max, 50))).max())
    if far <= _FARTHEST_M and shift <= _LARGEST_PUPIL_M:
        return []
    told = f"the target stands {far:.3g} m away and the entrance pupil moves by {1e3 * shift:.3g} mm"
    advice = ": are the target file's lengths in metres?"
    return [Finding("units", {"distance_m": far, "pupil_mm": 1e3 * shift}, True, told + advice)]


def largest_lattice(points: np.ndarray, image_index: np.ndarray, point_index: np.ndarray) -> tuple[int, ...] | None:
    """Columns and rows of the file, then those of a smaller lattice that no view exceeds and many show whole; or None.

    A board that is smaller than its file fits it in several places, across too: its labels shift from view to view, but
    no view ever shows more of it. points (n, 3): metres. image_index, point_index (M,): of the sightings. Which of the
    smaller lattice's two counts is the larger follows the file: it may lie across.
    """
    grid = np.stack([np.unique(np.round(axis, 6), return_inverse=True)[1] for axis in points[:, :2].T], axis=1)
    columns, rows = (int(count) + 1 for count in grid.max(axis=0))
    if columns * rows == 2 * len(points):  # every second place is empty: an asymmetric grid
        grid[:, 0] //= 2
        columns //= 2
    if columns * rows != len(points) or min(columns, rows) < 4:
        return None
    order = np.argsort(image_index, kind="stable")
    views, starts = np.unique(image_index[order], return_index=True)
    points_of_view = [np.unique(part) for part in np.split(point_index[order], starts[1:])]
    spans = np.sort([np.ptp(grid[part], axis=0) + 1 for part in points_of_view], axis=1)
    few, many = (int(count) for count in spans.max(axis=0)) if len(views) else (0, 0)
    whole = sum(len(part) == few * many for part in points_of_view)
    if (few, many) == (min(columns, rows), max(columns, rows)) or whole < max(_LEAST_VIEWS, _LEAST_SHARE * len(views)):
        return None
    return (columns, rows, many, few) if columns >= rows else (columns, rows, few, many)
