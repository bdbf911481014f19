"""Points from two views: what rays without a common origin are worth."""

from __future__ import annotations

import numpy as np

from fisheye_ep_calib.calibration import calibrate
from fisheye_ep_calib.calibration.assessing.stand_in import single_viewpoint
from fisheye_ep_calib.rig.triangulation import rays_in, triangulate
from fisheye_ep_calib.simulation import Imaging, laikin_camera, observe, paper_poses, render
from fisheye_ep_calib.target.boards.chessboard import Chessboard


def test_rays_through_points_meet_in_them() -> None:
    rng = np.random.default_rng(0)
    points, origins = rng.normal(size=(5, 4, 3)), rng.normal(size=(3, 5, 4, 3))
    directions = points - origins
    directions /= np.linalg.norm(directions, axis=-1, keepdims=True)
    assert np.allclose(triangulate(origins, directions), points)
    used = np.ones((3, 5, 4), bool)
    used[0] = False
    spoilt = directions.copy()
    spoilt[0] = np.nan
    assert np.allclose(triangulate(origins, spoilt, used), points)


def test_open_points_are_nan() -> None:
    origins, directions = np.zeros((2, 2, 3)), np.zeros((2, 2, 3))
    origins[1, :, 0] = 1.0
    directions[..., 2] = 1.0
    directions[1, 1] = [-0.6, 0.0, 0.8]
    found = triangulate(origins, directions)
    assert np.isnan(found[0]).all() and np.allclose(found[1], [0, 0, 4 / 3])
    assert np.isnan(triangulate(origins, directions, np.array([[True] * 2, [False] * 2]))).all()


def test_a_length_of_100_mm_at_120_mm(capsys) -> None:
    """Two rendered images, from places 60 mm apart, of a board 120 mm in front of a ray-traced lens."""
    lens, small = laikin_camera(), Chessboard.create("small", 11, 7, spacing=0.012)
    observations = observe(lens, small, paper_poses(small), noise=0.05)
    with_pupil = calibrate(observations, model="ep_even").camera
    cameras = {
        "entrance pupil": with_pupil,
        "calibrated without pupil": calibrate(observations, model="kannala").camera,
        "stand-in at infinity": single_viewpoint(with_pupil).camera,
        "stand-in at 120 mm": single_viewpoint(with_pupil, 0.12).camera,
    }
    board = Chessboard.create("board", 15, 9, spacing=0.0125)
    world_from_camera = np.tile(np.eye(4), (2, 1, 1))
    world_from_camera[:, 0, 3] = -0.03, 0.03
    corners = []
    for number, pose in enumerate(world_from_camera):
        camera_from_target = np.eye(4)
        camera_from_target[:3, 3] = np.array([0, 0, 0.12]) - board.object_points.mean(axis=0) - pose[:3, 3]
        image = render(lens, board, camera_from_target, Imaging(blur=0.7, noise=2.0, seed=number))
        found = board.detector().detect(image)
        assert len(found) == len(board.object_points), found.reason
        corners.append(found.pixels[np.argsort(found.point_index)])

    column, row = np.meshgrid(np.arange(15 - 8), np.arange(9))
    first = (row * 15 + column).ravel()  # 8 squares of 12.5 mm apart along a row: 100 mm
    errors = {}
    for name, camera in cameras.items():
        rays = [
            rays_in(pose, *camera.unproject(pixels)[:2])
            for pose, pixels in zip(world_from_camera, corners, strict=True)
        ]
        points = triangulate(*(np.stack(part) for part in zip(*rays, strict=True)))
        errors[name] = 1e3 * (np.linalg.norm(points[first + 8] - points[first], axis=-1) - 0.1)
    with capsys.disabled():
        print(f"\nerror of {len(first)} lengths of 100 mm at 120 mm, triangulated from two images:")
        for name, error in errors.items():
            print(f"  {name:<28}RMS {np.sqrt((error**2).mean()):.3f} mm, largest {np.abs(error).max():.3f} mm")
    largest = {name: np.abs(error).max() for name, error in errors.items()}
    assert largest.pop("entrance pupil") <= 0.1
    assert min(largest.values()) > 0.2
