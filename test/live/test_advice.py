"""What a calibration advises to show next."""

from __future__ import annotations

import numpy as np
from known_scenes import BOARD, CAMERA, poses_of, seen

from fisheye_ep_calib.calibration import Observations, calibrate
from fisheye_ep_calib.live.advice import AHEAD, advise
from fisheye_ep_calib.planning.detectability import Board
from fisheye_ep_calib.planning.view_selection import view_signature


def advice_from(poses: np.ndarray):
    observations = seen(CAMERA, BOARD.object_points, poses, 0.1)
    return observations, advise(calibrate(observations, model="ep_even"), observations, Board.of(BOARD))


def signatures(observations: Observations):
    for image in np.unique(observations.image_index):
        of = observations.image_index == image
        points = observations.object_points[observations.point_index[of]]
        yield view_signature(points, observations.pixels[of], observations.image_size)


def test_what_was_shown_is_not_asked_for_though_another_view_there_would_tell_most() -> None:
    poses = poses_of(8, 3)
    for _ in range(6):  # as long as there is something to tell
        observations, advice = advice_from(poses)
        assert len(advice.plan) == AHEAD
        assert not any(wanted.shown_by(view) for wanted in advice.plan for view in signatures(observations))
        poses = np.concatenate([poses, [wanted.suggestion.camera_from_target for wanted in advice.plan]])
