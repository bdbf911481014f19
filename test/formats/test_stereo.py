"""Stereo CameraInfo: a point has the same row in both rectified images, and the disparity f B / Z."""

from __future__ import annotations

import numpy as np
import pytest

from fisheye_ep_calib import InputError
from fisheye_ep_calib.camera import FisheyeCamera
from fisheye_ep_calib.formats.placed_camera import PlacedCamera
from fisheye_ep_calib.formats.stereo import rectified_pair
from fisheye_ep_calib.rotation import rotation_from_vector

CAMERA = FisheyeCamera((1280, 960), 400, 401, 642.3, 477.7, radial=(0.03, -0.004, 0.001, -0.0002), theta_max=1.5)


def placed(name: str, turn=(0.0, 0.0, 0.0), shift=(0.0, 0.0, 0.0)) -> PlacedCamera:
    pose = np.eye(4)
    pose[:3, :3], pose[:3, 3] = rotation_from_vector(np.array(turn)), shift
    return PlacedCamera(name, CAMERA, reference_from_camera=pose)


def test_rows_correspond_and_disparity_is_depth() -> None:
    left, right = (
        placed("left", (0.02, -0.05, 0.01), (0.3, 0.1, -0.2)),
        placed("right", (-0.03, 0.1, 0.02), (0.42, 0.11, -0.19)),
    )
    pair = rectified_pair(left, right)
    points = np.random.default_rng(1).uniform([-0.5, -0.5, 0.5], [0.5, 0.5, 3], (100, 3))  # in the reference's frame
    seen = []
    for one, turn, projection in zip((left, right), pair.rectified_from_camera, pair.projection, strict=True):
        assert np.allclose(turn @ turn.T, np.eye(3)) and np.linalg.det(turn) > 0
        assert turn[0, 0] > 0.9 and turn[1, 1] > 0.9 and turn[2, 2] > 0.9  # not turned over
        pose = one.camera_from_reference
        rectified = (points @ pose[:3, :3].T + pose[:3, 3]) @ turn.T
        image = rectified @ pair.projection[0][:, :3].T  # P's Tx turns a point of the left frame into the right image
        seen.append((rectified, image[:, :2] / image[:, 2:]))
        assert projection[1, 3] == projection[2, 3] == 0
    (from_left, left_pixels), (_, right_pixels) = seen
    np.testing.assert_allclose(left_pixels[:, 1], right_pixels[:, 1], atol=1e-9)
    focal, tx = pair.projection[1][0, 0], pair.projection[1][0, 3]
    baseline = np.linalg.norm([0.12, 0.01, 0.01])
    assert tx == pytest.approx(-focal * baseline)
    np.testing.assert_allclose(left_pixels[:, 0] - right_pixels[:, 0], focal * baseline / from_left[:, 2], atol=1e-9)
    by_info = np.column_stack([from_left, np.ones(100)]) @ pair.projection[1].T  # as image_geometry takes P
    np.testing.assert_allclose(by_info[:, :2] / by_info[:, 2:], right_pixels, atol=1e-9)


@pytest.mark.parametrize(
    ("shift", "words"),
    [
        ((-0.1, 0, 0), "name it first"),
        ((0, 0.1, 0), "side by side"),
        ((0, 0, 0.1), "side by side"),
        ((0, 0, 0), "side"),
    ],
)
def test_what_is_no_pair_is_refused(shift, words) -> None:
    with pytest.raises(InputError, match=words):
        rectified_pair(placed("one"), placed("other", shift=shift))
