"""What shape the target has that all cameras of a rig see: one for all, whichever explains their views best.

Each camera compares the shapes that are known and one of its own, the camera held (assessing/evaluated_board.py). What
one of them estimates must then explain what the others see better than what is known.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from fisheye_ep_calib.calibration.assessing.evaluated_board import (
    AS_FILE,
    ESTIMATED,
    MEASURED,
    EvaluatedBoard,
    evaluated_board,
    held_out_px,
)
from fisheye_ep_calib.calibration.observations import Observations
from fisheye_ep_calib.camera import FisheyeCamera
from fisheye_ep_calib.target.shape.measured import BoardShape, known_board


def rig_board(
    cameras: Sequence[FisheyeCamera], observations: Sequence[Observations], measured: BoardShape | None
) -> EvaluatedBoard:
    """observations: of each camera, every point under one name. measured: the shape that a calibration found."""
    compared = [
        evaluated_board(camera, of_camera, measured) for camera, of_camera in zip(cameras, observations, strict=True)
    ]
    shapes: dict[str, BoardShape | None] = {AS_FILE: known_board(of_camera.board for of_camera in observations)}
    if measured is not None and measured.bends and measured.same_target(observations[0].object_points):
        shapes[MEASURED] = measured
    own = known_board(each.board for each in compared if each.source == ESTIMATED)
    held_out = [dict(each.held_out_px) for each in compared]
    if own is not None:
        for camera, of_camera, each, errors in zip(cameras, observations, compared, held_out, strict=True):
            if errors and each.board is not own:
                errors[ESTIMATED] = held_out_px(camera, of_camera, own)
        shapes[ESTIMATED] = own
    total = {source: _root_mean_square(held_out, source) for source in shapes}
    best = min(total, key=lambda source: total[source])
    return EvaluatedBoard(best, shapes[best], total, any(each.ambiguous for each in compared))


def _root_mean_square(held_out: Sequence[Mapping[str, float]], source: str) -> float:
    """Over the cameras that have views enough to compare shapes, px."""
    square = [errors[source] ** 2 for errors in held_out if source in errors]
    return float(np.sqrt(np.mean(square))) if square else 0.0
