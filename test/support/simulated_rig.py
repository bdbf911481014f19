"""Rigs of known cameras in known places, and what each of them sees of a target."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np
import yaml

from fisheye_ep_calib.calibration.assessing.stand_in import single_viewpoint
from fisheye_ep_calib.camera import FisheyeCamera
from fisheye_ep_calib.camera.camera_info import camera_info_content, plain_camera_info
from fisheye_ep_calib.rig import RigCamera
from fisheye_ep_calib.rig.symmetry import symmetries
from fisheye_ep_calib.rotation import rotation_from_vector
from fisheye_ep_calib.simulation import look_pose, observe, paper_camera
from fisheye_ep_calib.target import Target

NAMES = ("front", "left", "rear")
PERIOD_NS = 10**8


def place(yaw_deg: float, position: Sequence[float], tilt: Sequence[float] = (0.0, 0.0, 0.0)) -> np.ndarray:
    """reference_from_camera (4, 4): turned about y, then a little otherwise."""
    pose = np.eye(4)
    pose[:3, :3] = rotation_from_vector(np.array([0, np.radians(yaw_deg), 0])) @ rotation_from_vector(np.array(tilt))
    pose[:3, 3] = position
    return pose


def cameras(count: int, theta_max_deg: float = 97.5) -> list[FisheyeCamera]:
    """Siblings of the paper's camera, with a pupil that moves by millimetres as real ones do."""
    return [
        replace(
            paper_camera(number),
            model="ep_even",
            coefficients=(-0.004 - 0.0005 * number, -0.0008),
            theta_max=np.radians(theta_max_deg),
        )
        for number in range(count)
    ]


def targets_between(
    a: np.ndarray, b: np.ndarray, target: Target, count: int, seed: int, distance=(0.15, 0.35), theta_deg=20.0
) -> np.ndarray:
    """Poses reference_from_target (count, 4, 4) of a target held where two cameras, by their poses, both see it.

    distance, theta_deg: of the target's middle from the place between the cameras, metres, and from the axis between
    theirs, at most.
    """
    rng = np.random.default_rng(seed)
    axis = a[:3, 2] + b[:3, 2]
    view = np.eye(4)
    view[:3, 2] = axis / np.linalg.norm(axis)
    view[:3, 1] = a[:3, 1] - (a[:3, 1] @ view[:3, 2]) * view[:3, 2]
    view[:3, 1] /= np.linalg.norm(view[:3, 1])
    view[:3, 0] = np.cross(view[:3, 1], view[:3, 2])
    view[:3, 3] = (a[:3, 3] + b[:3, 3]) / 2
    return np.stack(
        [
            view
            @ look_pose(
                target,
                theta=np.radians(rng.uniform(0, theta_deg)),
                azimuth=rng.uniform(-np.pi, np.pi),
                distance=rng.uniform(*distance),
                tilt=np.radians(rng.uniform(0, 30)),
                tilt_azimuth=rng.uniform(-np.pi, np.pi),
                roll=rng.uniform(-np.pi, np.pi),
            )
            for _ in range(count)
        ]
    )


def see(
    models: Sequence[FisheyeCamera],
    reference_from_camera: Sequence[np.ndarray],
    target: Target,
    reference_from_target: np.ndarray,
    noise: float = 0.1,
    seed: int = 0,
    jitter_ns: int = 10**6,
    turned: bool = False,
) -> list[RigCamera]:
    """turned: each view's points are counted from any end of the target at which it looks the same."""
    rng = np.random.default_rng(seed)
    turns = symmetries(target.object_points)
    seen = []
    for number, (model, pose) in enumerate(zip(models, reference_from_camera, strict=True)):
        poses = np.linalg.inv(pose) @ reference_from_target
        observations = observe(model, target, poses, noise, seed=100 * seed + number)
        if turned:
            index = observations.point_index.copy()
            for image in np.unique(observations.image_index):
                rows = observations.image_index == image
                index[rows] = turns[rng.integers(len(turns))].becomes[index[rows]]
            observations = replace(observations, point_index=index)
        stamps = PERIOD_NS * np.arange(len(poses)) + rng.integers(-jitter_ns, jitter_ns + 1, len(poses))
        seen.append(RigCamera(NAMES[number], model, observations, stamps))
    return seen


def errors(found: np.ndarray, truth: np.ndarray) -> tuple[float, float]:
    """Angle (rad) and distance (metres) between two poses (4, 4)."""
    turn = found[:3, :3].T @ truth[:3, :3]
    angle = np.arccos(np.clip((np.trace(turn) - 1) / 2, -1, 1))
    return float(angle), float(np.linalg.norm(found[:3, 3] - truth[:3, 3]))


def write_camera(path: Path, camera: FisheyeCamera, name: str) -> None:
    """A camera file as the calibration writes it, without what a calibration knows."""
    info = camera_info_content(plain_camera_info(single_viewpoint(camera).camera), name)
    info["entrance_pupil"] = {
        "schema": 1,
        "model": camera.model,
        "intrinsics": {key: float(getattr(camera, key)) for key in ("fx", "fy", "skew", "cx", "cy")},
        "radial": list(camera.radial),
        "coefficients": list(camera.coefficients),
        "theta_max": float(camera.theta_max),
    }
    path.write_text(yaml.safe_dump(info))
