"""Where to hold the target next: the pose that narrows what is known least about E(θ) and r(θ) most.

A greedy design (view_information.variance_reduction): the variances, each relative to its present value, are those
of E(θ) and of r(θ) over the field.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from fisheye_ep_calib.calibration.assessing.coverage import SECTOR_NAMES, sector_of
from fisheye_ep_calib.camera import FisheyeCamera
from fisheye_ep_calib.planning.view_information import variance_reduction, view_information
from fisheye_ep_calib.rotation import placed, rotation_from_vector
from fisheye_ep_calib.target.shape.frame import board_middle

_DIRECTIONS = np.radians([0.0, 30.0, 50.0, 65.0, 78.0, 88.0])
_AZIMUTHS = 8
_TILTS = np.radians([0.0, 25.0, 45.0])
_TILT_AZIMUTHS = 4
_MOST_POINTS = 40  # of the target: enough to tell poses apart


@dataclass(frozen=True)
class Suggestion:
    """A pose worth recording. theta, azimuth: direction of the target's middle, rad; distance: metres; tilt: rad.

    camera_from_target (4, 4). gain: the share by which these variances would shrink in the mean.
    """

    theta: float
    azimuth: float
    distance: float
    tilt: float
    camera_from_target: np.ndarray
    gain: float

    @property
    def sentence(self) -> str:
        """What to tell the person who holds the target."""
        degrees = np.degrees(self.theta)
        sector = SECTOR_NAMES[sector_of(self.azimuth, len(SECTOR_NAMES))]
        where = "in the middle of the image"
        if degrees > 10:
            where = (
                f"towards the {sector} {'edge' if degrees > 60 else 'part'} of the image ({degrees:.0f}° off the axis)"
            )
        how = "facing the camera" if self.tilt < np.radians(10) else f"tilted by about {np.degrees(self.tilt):.0f}°"
        return f"hold the target {where}, about {100 * self.distance:.0f} cm away, {how}"


def next_view(
    camera: FisheyeCamera,
    object_points: np.ndarray,
    camera_from_target: np.ndarray,
    distances: tuple[float, ...],
) -> Suggestion:
    """The pose among a grid of them that would tell most.

    camera: as calibrated so far, with a pupil model; object_points (n, 3), metres; camera_from_target (V, 4, 4): the
    views so far; distances: metres, where the target may be held.
    """
    step = max(1, len(object_points) // _MOST_POINTS)
    points = object_points[::step]
    camera = replace(camera, theta_max=np.pi)
    so_far = view_information(camera, points, camera_from_target).information.sum(axis=0)
    grid, poses = _candidate_poses(object_points, camera_from_target, distances)
    information = view_information(camera, points, poses).information
    sought = sought_rows(camera)
    gain = variance_reduction(information, so_far, sought) / len(sought)
    best = int(np.argmax(gain))
    theta, azimuth, distance, tilt = (float(value) for value in grid[best])
    return Suggestion(theta, azimuth, distance, tilt, poses[best], float(gain[best] / (1 + gain[best])))


def sought_rows(camera: FisheyeCamera) -> np.ndarray:
    """Rows (Q, P): derivatives of E(θ) and of fx r(θ) by the camera's parameters, over the field."""
    theta = np.linspace(0.3, 1.0, 12) * min(camera.theta_limit, np.pi / 2)
    count = len(camera.parameters)
    radial = np.zeros((len(theta), count))
    radial[:, 0] = camera.radius(theta)
    radial[:, camera.parameter_slice("radial")] = (
        camera.fx * camera.lens_model.radius_jacobian(theta, camera.radial_array).T
    )
    pupil = np.zeros((len(theta), count))
    pupil[:, camera.parameter_slice("coefficients")] = camera.pupil_family.basis(theta, len(camera.coefficients)).T
    return np.concatenate([pupil, radial])


def _candidate_poses(
    object_points: np.ndarray, camera_from_target: np.ndarray, distances: Sequence[float]
) -> tuple[np.ndarray, np.ndarray]:
    """Grid (F, 4) of (θ, azimuth, distance, tilt) and poses (F, 4, 4); the side that was shown so far is shown."""
    middle = board_middle(object_points)
    in_camera = placed(camera_from_target, middle)
    away = np.median((camera_from_target[:, :3, 2] * in_camera).sum(axis=-1)) > 0
    azimuths = 2 * np.pi * np.arange(_AZIMUTHS) / _AZIMUTHS
    turns = 2 * np.pi * np.arange(_TILT_AZIMUTHS) / _TILT_AZIMUTHS
    axes = np.meshgrid(_DIRECTIONS, azimuths, np.array(distances), _TILTS, turns, indexing="ij")
    theta, azimuth, distance, tilt, turn = (axis.ravel() for axis in axes)
    unique = ((theta > 0) | (azimuth == 0)) & ((tilt > 0) | (turn == 0))
    theta, azimuth, distance, tilt, turn = (axis[unique] for axis in (theta, azimuth, distance, tilt, turn))
    zero = np.zeros_like(theta)
    toward = rotation_from_vector(np.stack([-theta * np.sin(azimuth), theta * np.cos(azimuth), zero], axis=-1))
    tilted = rotation_from_vector(np.stack([tilt * np.cos(turn), tilt * np.sin(turn), zero], axis=-1))
    facing = np.eye(3) if away else np.diag([1.0, -1.0, -1.0])
    poses = np.tile(np.eye(4), (len(theta), 1, 1))
    poses[:, :3, :3] = toward @ tilted @ facing
    poses[:, :3, 3] = distance[:, None] * toward[:, :, 2] - poses[:, :3, :3] @ middle
    return np.stack([theta, azimuth, distance, tilt], axis=-1), poses
