"""What a calibration may estimate beside the camera, for every kind of target and through every door alike."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from registered_targets import CAMERA, named_target

from fisheye_ep_calib import Observations, load_camera
from fisheye_ep_calib.live.outcome import calibrate_views
from fisheye_ep_calib.pipeline import calibrate_recording
from fisheye_ep_calib.planning.detectability import Board
from fisheye_ep_calib.simulation import observe, random_poses
from fisheye_ep_calib.storage.observation_file import save_observations
from fisheye_ep_calib.target.shape.basis import smooth_fields
from fisheye_ep_calib.target.shape.frame import board_frame

VIEWS, NOISE = 10, 0.05
FLEX = 3e-3  # of the board's size, RMS of each field


@pytest.fixture(scope="module")
def flexing(target_kind) -> tuple:
    """A target, and views of it that bends otherwise in each."""
    target, _ = named_target(target_kind)
    points, rng = target.object_points, np.random.default_rng(3)
    size = float(np.ptp(points, axis=0).max())
    fields = smooth_fields(board_frame(points), points, np.ones(len(points), bool), 2)
    heights = fields.value[..., fields.group == 0]
    poses = random_poses(target, VIEWS, 3, (0.8 * size, 2.5 * size), (0.0, 75.0), (5.0, 50.0))
    amounts = rng.normal(0, FLEX * size, (VIEWS, 3))
    bent = [replace(target, object_points=points + heights @ amount) for amount in amounts]
    seen = [observe(CAMERA, bent[view], poses[view][None], NOISE, seed=view) for view in range(VIEWS)]
    index = np.concatenate([np.full(len(one.pixels), view) for view, one in enumerate(seen)])
    observations = Observations.create(
        points,
        index,
        np.concatenate([one.point_index for one in seen]),
        np.concatenate([one.pixels for one in seen]),
        CAMERA.image_size,
        disc_radius=target.disc_radius,
    )
    return target, observations


def test_flex_is_estimated_through_every_door(flexing, command, tmp_path) -> None:
    target, observations = flexing
    save_observations(tmp_path / "front.npz", observations)
    python = calibrate_recording(tmp_path / "front.npz", model="ep_even", flex=True)["front"]
    assert python.fit.problem.effects.names == ("flex",) and python.fit.sigma_px < 1.2 * NOISE
    live = calibrate_views(observations, "ep_even", "front", "", Board.of(target), options={"flex": True})
    said = command("calibrate", tmp_path / "front.npz", "--model", "ep_even", "--flex", "--no-report", "--json")
    assert said.code == 0, said.err
    written = load_camera(said.json["cameras"]["front"]["yaml"])
    for camera in (live.camera, written):
        np.testing.assert_allclose(camera.parameters, python.camera.parameters, rtol=0, atol=1e-9)
