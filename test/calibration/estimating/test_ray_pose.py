"""Poses from rays where a camera sees hardly any of them."""

import numpy as np
import pytest

from fisheye_ep_calib.calibration.estimating.ray_pose import poses_from_rays
from fisheye_ep_calib.target.shape.frame import board_frame

POINTS = 12


@pytest.mark.filterwarnings("error")
@pytest.mark.parametrize("robust", [False, True])
@pytest.mark.parametrize("seen", [0, 1, 2, 3, 4])
@pytest.mark.parametrize("depth", [0.0, 0.1])
def test_views_of_few_rays_have_a_pose_and_do_not_harm_others(depth, seen, robust):
    rng = np.random.default_rng(4)
    points = rng.uniform(-0.2, 0.2, (POINTS, 3)) * [1.0, 1.0, depth]
    camera = points + [0.05, -0.02, 0.5]
    rays = np.repeat((camera / np.linalg.norm(camera, axis=1, keepdims=True)).T[:, None], 2, axis=1)
    used = np.stack([np.arange(POINTS) < seen, np.ones(POINTS, bool)])

    poses = poses_from_rays(rays, np.repeat(points.T[:, None], 2, axis=1), used, board_frame(points), robust=robust)

    assert np.isfinite(poses).all()
    np.testing.assert_allclose(
        poses[:, :3, :3] @ poses[:, :3, :3].swapaxes(1, 2), np.tile(np.eye(3), (2, 1, 1)), atol=1e-9
    )
    np.testing.assert_allclose(poses[1], [[1, 0, 0, 0.05], [0, 1, 0, -0.02], [0, 0, 1, 0.5], [0, 0, 0, 1]], atol=1e-6)
