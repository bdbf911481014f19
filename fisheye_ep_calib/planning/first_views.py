"""Where to hold the target while nothing is known of the camera: in the middle, at the edges, near, far and tilted."""

from __future__ import annotations

from itertools import product

import numpy as np

from fisheye_ep_calib.camera import FisheyeCamera
from fisheye_ep_calib.planning.detectability import Board, Sight, detectable
from fisheye_ep_calib.planning.guidance import Suggestion, candidate_poses

_FULL_FRAME = 0.95  # of the image lit: no image circle is seen
_HALF_FIELD_OF_FULL_FRAME = np.radians(60.0)  # of the image's width
_EDGE_OF_CIRCLE = np.radians(90.0)
# (share of the edge's angle, sector of 8, half angle that the board fills and tilt, degrees), in the order to go.
_PLAN = (
    (0.0, 0, 27, 0), (0.6, 0, 17, 0), (0.6, 4, 17, 0), (0.6, 6, 17, 0), (0.6, 2, 17, 0), (0.0, 0, 40, 25),
    (0.6, 1, 17, 25), (0.6, 5, 17, 25), (0.6, 7, 17, 25), (0.6, 3, 17, 25), (0.0, 0, 14, 25), (0.3, 0, 24, 45),
    (0.3, 4, 24, 45), (0.75, 0, 13, 0), (0.75, 4, 13, 0), (0.75, 6, 13, 0), (0.75, 2, 13, 0), (0.3, 2, 12, 45),
)  # fmt: skip
_LESS = (1.0, 0.85, 0.7, 0.5)  # of the angle, until the board is inside the image
_NEARER = (1.0, 0.85, 0.7, 0.55)  # of the distance, until its features are large enough


def assumed_camera(image_size: tuple[int, int], sight: Sight) -> FisheyeCamera:
    """An equidistant camera r = f θ, as like the real one as an image tells: its circle ends at 90°.

    Where light fills the image, its width is 120°.
    """
    width, height = image_size
    share = float(sight.lit.mean())
    focal = width / 2 / _HALF_FIELD_OF_FULL_FRAME
    centre = np.array([width - 1, height - 1]) / 2
    if 0 < share < _FULL_FRAME:
        rows, columns = np.nonzero(sight.lit)
        cells = np.array(sight.lit.shape[::-1])
        middle = (np.array([columns.min() + columns.max() + 1, rows.min() + rows.max() + 1]) / 2) / cells
        centre = middle * np.array(image_size) - 0.5
        focal = max(np.ptp(columns) + 1, 1) / cells[0] * width / 2 / _EDGE_OF_CIRCLE
    return FisheyeCamera(
        image_size=image_size,
        fx=float(focal),
        fy=float(focal),
        skew=0.0,
        cx=float(centre[0]),
        cy=float(centre[1]),
        radial=(0.0, 0.0, 0.0, 0.0),
        theta_max=np.pi,
    )


def first_views(
    board: Board, image_size: tuple[int, int], sight: Sight, away: bool, known: FisheyeCamera | None = None
) -> list[Suggestion]:
    """Poses before the camera, in the order in which to take them; those that it could not see are left out.

    known: the camera, where one is; else the assumed one stands for it. away: as in ``candidate_poses``.
    """
    camera = known or assumed_camera(image_size, sight)
    edge = _EDGE_OF_CIRCLE if sight.lit.mean() < _FULL_FRAME else _HALF_FIELD_OF_FULL_FRAME
    edge = edge if known is None else min(known.theta_limit, _EDGE_OF_CIRCLE)
    chosen: list[Suggestion] = []
    for share, sector, half_angle, tilt in _PLAN:
        farthest = board.radius / np.tan(np.radians(half_angle))
        for nearer, less in product(_NEARER, _LESS):
            distance, theta = nearer * farthest, less * share * edge
            grid, poses = candidate_poses(board.points, away, (distance,), (theta,), (np.radians(tilt),))
            fitting = detectable(camera, board, poses, sight)
            numbers = np.flatnonzero(fitting & ((grid[:, 0] == 0) | np.isclose(grid[:, 1], sector * np.pi / 4)))
            if len(numbers):
                number = numbers[len(chosen) % len(numbers)]  # tilts about one axis after the other
                theta, azimuth, distance, angle = (float(value) for value in grid[number])
                chosen.append(Suggestion(theta, azimuth, distance, angle, poses[number], 0.0, guessed=known is None))
                break
    return chosen
