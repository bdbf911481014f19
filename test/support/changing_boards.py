"""Boards that change from view to view, or that move while the shutter rolls."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from bent_boards import bent
from known_scenes import BOARD, CAMERA, poses_of, seen

from fisheye_ep_calib.calibration import Observations
from fisheye_ep_calib.rotation import rotation_from_vector
from fisheye_ep_calib.target.shape.basis import smooth_fields
from fisheye_ep_calib.target.shape.frame import board_frame


def seen_changing(
    flex: float = 0.0,
    in_plane: float = 0.0,
    turn: float = 0.0,
    shift: float = 0.0,
    wave: float = 0.0,
    rough: float = 0.0,
    views: int = 20,
    noise: float = 0.1,
    seed: int = 1,
) -> Observations:
    """What a camera sees of a board whose file knows nothing of all this.

    flex, in_plane: standard deviation of each field's coefficient in a view, metres. turn, shift: of the motion within
    one image, rad and metres. wave: of the board itself, metres. rough: standard deviation of what every point is off
    by itself, metres.
    """
    nominal, rng = BOARD.object_points, np.random.default_rng([seed, 8])
    still = bent(nominal, "wave", wave, seed) if wave else nominal
    still = still + np.random.default_rng([seed, 9]).normal(0, rough, nominal.shape)
    poses = poses_of(views, seed)
    fields = smooth_fields(board_frame(nominal), nominal, np.ones(len(nominal), bool), 2).value
    observations = seen(CAMERA, still, poses, 0.0, seed)
    pixels = observations.pixels.copy()
    for view in np.unique(observations.image_index):
        rows = np.flatnonzero(observations.image_index == view)
        points = observations.point_index[rows]
        amounts = np.concatenate([rng.normal(0, flex, 3), rng.normal(0, in_plane, 8)])
        rotation, place = poses[view][:3, :3], poses[view][:3, 3]
        middle = rotation @ nominal.mean(axis=0) + place
        arms = (still[points] + fields[points] @ amounts) @ rotation.T + place - middle
        twist, speed = rng.normal(0, turn, 3), rng.normal(0, shift, 3)
        found = pixels[rows]
        for _ in range(3):  # the row where a point is seen says when it is
            time = ((found[:, 1:] + 0.5) / observations.image_size[1]) - 0.5
            moved = np.einsum("nij,nj->ni", rotation_from_vector(time * twist), arms) + time * speed
            found, _ = CAMERA.project(middle + moved)
        pixels[rows] = found
    return replace(observations, pixels=pixels + rng.normal(0, noise, pixels.shape), object_points=nominal)
