"""Cameras of which nothing is told to the calibration, and what they see of known points at known poses."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from fisheye_ep_calib.calibration import CalibrationResult, Observations
from fisheye_ep_calib.camera import FisheyeCamera
from fisheye_ep_calib.simulation import random_poses
from fisheye_ep_calib.target.boards.chessboard import Chessboard

BOARD = Chessboard.create("board", 9, 6, 0.02)
CAMERA = FisheyeCamera(
    image_size=(1600, 1200),
    fx=480.0,
    fy=483.0,
    skew=0.3,
    cx=812.0,
    cy=590.0,
    radial=(0.01, -0.002, 0.0003, 0.0),
    model="ep_even",
    coefficients=(-0.6e-3, -0.1e-3),
    theta_max=np.radians(110),
)


def half_size(camera: FisheyeCamera) -> FisheyeCamera:
    """The camera of images half as wide and high; the centre of the top-left pixel stays (0, 0)."""
    width, height = camera.image_size
    return replace(
        camera,
        image_size=(width // 2, height // 2),
        fx=camera.fx / 2,
        fy=camera.fy / 2,
        cx=(camera.cx + 0.5) / 2 - 0.5,
        cy=(camera.cy + 0.5) / 2 - 0.5,
    )


def poses_of(views: int = 25, seed: int = 1, theta_deg: float = 80.0) -> np.ndarray:
    """Poses (views, 4, 4) of the board, 0.12 to 0.35 m away, tilted by 5 to 50°."""
    return random_poses(BOARD, views, seed, (0.12, 0.35), (0.0, theta_deg), (5.0, 50.0))


def seen(
    camera: FisheyeCamera, points: np.ndarray, poses: np.ndarray, noise: float = 0.1, seed: int = 0
) -> Observations:
    """The points (n, 3) at poses (V, 4, 4) that appear in the image, with Gaussian noise of σ px a coordinate.

    Views that show fewer than 8 are left out.
    """
    rng = np.random.default_rng([seed, 5])
    in_camera = points @ np.swapaxes(poses[:, :3, :3], 1, 2) + poses[:, None, :3, 3]
    pixels, valid = camera.project(in_camera)
    pixels = pixels + rng.normal(0, noise, pixels.shape)
    inside = valid & (pixels > 0).all(axis=-1) & (pixels < np.array(camera.image_size) - 1).all(axis=-1)
    image, point = np.nonzero(inside & (inside.sum(axis=1) >= 8)[:, None])
    return Observations.create(points, image, point, pixels[image, point], camera.image_size)


def seen_board(camera: FisheyeCamera = CAMERA, views: int = 25, noise: float = 0.1, seed: int = 1) -> Observations:
    return seen(camera, BOARD.object_points, poses_of(views, seed), noise, seed)


def parallel_boards(tilt: float) -> Observations:
    """Twelve boards at one distance whose normals lie within a tilt, rad, of the axis."""
    rng = np.random.default_rng(4)
    poses = np.tile(np.eye(4), (12, 1, 1))
    for pose in poses:
        x, y = rng.uniform(-tilt, tilt, 2)
        turn = np.array([[1, 0, y], [0, 1, x], [-y, -x, 1]])
        pose[:3, :3] = np.linalg.qr(turn)[0] * np.sign(np.diag(np.linalg.qr(turn)[1]))
        pose[:3, 3] = [rng.uniform(-0.2, 0.05), rng.uniform(-0.12, 0.02), 0.25]
    return seen(CAMERA, BOARD.object_points, poses)


def rows(observations: Observations, keep: np.ndarray) -> Observations:
    """Some of the sightings; keep: bool or row numbers."""
    return replace(
        observations,
        image_index=observations.image_index[keep],
        point_index=observations.point_index[keep],
        pixels=observations.pixels[keep],
        weights=observations.weights[keep],
    )


def with_gross_errors(observations: Observations, share: float, seed: int = 0) -> tuple[Observations, np.ndarray]:
    """A share of the sightings anywhere in the image instead; which ones (M,)."""
    rng = np.random.default_rng([seed, 6])
    wrong = rng.random(len(observations.pixels)) < share
    anywhere = rng.uniform(0, np.array(observations.image_size) - 1.0, observations.pixels.shape)
    return replace(observations, pixels=np.where(wrong[:, None], anywhere, observations.pixels)), wrong


def unknown_scene(seed: int, theta_max_deg: float | None = None, views: int = 20) -> tuple[FisheyeCamera, Observations]:
    """A random camera whose image ends at a θ from 40 to 100°, its centre up to 5 % of the width off, and its views."""
    rng = np.random.default_rng([seed, 77])
    edge = np.radians(rng.uniform(40, 100) if theta_max_deg is None else theta_max_deg)
    width, height = 1600, 1200
    focal = width / 2 / edge
    camera = FisheyeCamera(
        image_size=(width, height),
        fx=focal * rng.uniform(0.98, 1.02),
        fy=focal * rng.uniform(0.98, 1.02),
        cx=width / 2 - 0.5 + rng.uniform(-0.05, 0.05) * width,
        cy=height / 2 - 0.5 + rng.uniform(-0.05, 0.05) * width,
        skew=rng.normal(0, 0.2),
        radial=tuple(rng.normal(0, [0.02, 0.005, 0.001, 0.0002])),
        model="ep_even",
        coefficients=(rng.uniform(-1e-3, -0.2e-3), rng.uniform(-0.2e-3, 0)),
        theta_max=min(1.35 * edge, 2.2),
    )
    return camera, seen(camera, BOARD.object_points, poses_of(views, seed, 0.85 * np.degrees(edge)), 0.1, seed)


def deviation(result: CalibrationResult, truth: FisheyeCamera) -> dict[str, float]:
    """Every estimated parameter minus its truth, in its own standard deviations; absent in the truth counts as 0."""
    true = dict(zip(truth.parameter_names, truth.parameters, strict=True))
    sigma = np.sqrt(np.diag(result.uncertainty.covariance))
    found = zip(result.camera.parameter_names, result.camera.parameters, sigma, strict=True)
    return {name: float(value - true.get(name, 0.0)) / s for name, value, s in found if s > 0}
