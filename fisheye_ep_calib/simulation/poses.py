"""Where a target stands before the camera: poses (4, 4) camera_from_target, alone and in seeded sets."""

from __future__ import annotations

import numpy as np

from fisheye_ep_calib.rotation import rotation_from_vector
from fisheye_ep_calib.simulation.patterns import printed_side
from fisheye_ep_calib.target import Target
from fisheye_ep_calib.target.shape.frame import board_middle

# Rings of directions for a calibration: (angle off the axis in degrees, number of views).
_PAPER_RINGS = ((0, 2), (32, 6), (58, 8), (78, 9))


def look_pose(
    target: Target,
    theta: float,
    azimuth: float,
    distance: float,
    tilt: float = 0.0,
    tilt_azimuth: float = 0.0,
    roll: float = 0.0,
) -> np.ndarray:
    """Pose (4, 4) of a target whose middle is seen in one direction and whose print looks back at the camera.

    theta, azimuth: direction of the middle of its points from the camera's origin, rad. distance: metres.
    tilt: angle between the line of sight and the board's normal, rad, about the axis at tilt_azimuth.
    roll: rotation of the print about the line of sight, rad.
    """
    toward = rotation_from_vector(theta * np.array([-np.sin(azimuth), np.cos(azimuth), 0]))
    tilted = rotation_from_vector(tilt * np.array([np.cos(tilt_azimuth), np.sin(tilt_azimuth), 0]))
    rotation = toward @ tilted @ rotation_from_vector(np.array([0, 0, roll]))
    if printed_side(target) > 0:
        rotation = rotation @ np.diag([1.0, -1.0, -1.0])
    middle = board_middle(target.object_points)
    pose = np.eye(4)
    pose[:3, :3] = rotation
    pose[:3, 3] = toward @ [0, 0, distance] - rotation @ middle
    return pose


def paper_poses(target: Target, seed: int = 0) -> np.ndarray:
    """25 poses (25, 4, 4) at 100–150 mm as in the paper, over the whole field, each ring at various depths.

    The boards of the outer ring pass the edge of the field: that is where the pupil moves most.
    """
    rng = np.random.default_rng([seed, 25])
    poses = []
    for angle, count in _PAPER_RINGS:
        distances = rng.permutation(np.linspace(0.10, 0.15, count))
        for view in range(count):
            poses.append(
                look_pose(
                    target,
                    theta=np.radians(angle + rng.uniform(-3, 3)) if angle else np.radians(rng.uniform(0, 5)),
                    azimuth=2 * np.pi * (view + rng.uniform(-0.2, 0.2)) / count + np.radians(angle),
                    distance=distances[view],
                    tilt=np.radians(rng.uniform(10, 40)),
                    tilt_azimuth=rng.uniform(0, 2 * np.pi),
                    roll=rng.uniform(-np.pi, np.pi),
                )
            )
    return np.stack(poses)


def random_poses(
    target: Target,
    count: int,
    seed: int,
    distance: tuple[float, float] = (0.10, 0.15),
    theta_deg: tuple[float, float] = (0.0, 80.0),
    tilt_deg: tuple[float, float] = (0.0, 40.0),
) -> np.ndarray:
    """Random poses (count, 4, 4): distance in metres, angles in degrees, each uniform in its range."""
    rng = np.random.default_rng([seed, 1])
    return np.stack(
        [
            look_pose(
                target,
                theta=np.radians(rng.uniform(*theta_deg)),
                azimuth=rng.uniform(-np.pi, np.pi),
                distance=rng.uniform(*distance),
                tilt=np.radians(rng.uniform(*tilt_deg)),
                tilt_azimuth=rng.uniform(-np.pi, np.pi),
                roll=rng.uniform(-np.pi, np.pi),
            )
            for _ in range(count)
        ]
    )
