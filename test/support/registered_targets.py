"""For each registered kind of target, files of it: those that are shipped, or else what its ``from_keys`` asks for."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import yaml

from fisheye_ep_calib.camera import FisheyeCamera
from fisheye_ep_calib.errors import InputError
from fisheye_ep_calib.simulation import Imaging, look_pose
from fisheye_ep_calib.target.base import Target
from fisheye_ep_calib.target.registry import TARGETS, parse_target
from fisheye_ep_calib.target.schema import LARGEST_COUNT, Keys

SHIPPED = sorted((Path(__file__).resolve().parents[2] / "config" / "targets").glob("*.yaml"))
IMAGING = Imaging(blur=0.7, noise=1.0, texture=20, shading=0.1, seed=3)
CAMERA = FisheyeCamera(
    image_size=(800, 760),
    fx=262.0,
    fy=263.0,
    cx=404.0,
    cy=377.0,
    skew=0.1,
    radial=(0.01, -0.002, 0.0003, 0.0),
    model="ep_even",
    coefficients=(-0.9e-3, -0.2e-3),
    theta_max=np.radians(100),
)


def target_files(kind: str) -> dict[str, dict]:
    """Name → keys of files of this kind, at least one. A kind that extends another reads the other's files too."""
    contents = {path.stem: yaml.safe_load(path.read_text()) for path in SHIPPED}
    for base in TARGETS[kind].__mro__:
        of_base = {
            name: {**keys, "type": kind} for name, keys in contents.items() if keys["type"] == vars(base).get("kind")
        }
        if of_base:
            return of_base
    return {"guessed": _guessed(kind)}


def named_target(kind: str) -> tuple[Target, dict]:
    """One target of a kind and the keys of its file: one that cannot be mistaken, where there is such a one."""
    files = target_files(kind)
    made = [(parse_target(keys, f"{name}.yaml", name), keys) for name, keys in files.items()]
    return max(made, key=lambda one: one[0].unmistakable)


class _Guess(Keys):
    """Answers what is asked for, plausibly, and notes it: counts 8, 7, 6 …, lengths 40 mm, 16 mm, 6.4 mm …"""

    def __init__(self) -> None:
        super().__init__({}, "guess")
        self.answers: dict = {}
        self.lengths = 0

    def count(self, key: str, least: int, most: int = LARGEST_COUNT) -> int:
        return self.answers.setdefault(key, min(most, max(least, 8 - len(self.answers))))

    def positive(self, key: str) -> float:
        self.lengths += key not in self.answers
        return self.answers.setdefault(key, 0.1 * 0.4**self.lengths)

    metres = positive

    def only(self, allowed) -> None:
        """All that is asked for is known."""


def _guessed(kind: str) -> dict:
    guess = _Guess()
    try:
        TARGETS[kind].from_keys(guess, "guessed")
    except InputError:
        pass  # then the file is refused where a test reads it, which says more
    return {"type": kind, **guess.answers}


def span(target: Target) -> float:
    """Diagonal of the points, metres."""
    return float(np.linalg.norm(np.ptp(target.object_points, axis=0)))


def whole_views(target: Target, rolls=(0.1, 1.9, 4.6)) -> np.ndarray:
    """Poses (V, 4, 4) that show the whole target, rolled by these angles, rad, tilted and off the axis."""
    return np.stack(
        [
            look_pose(target, 0.35, 0.8 + roll, (0.8 + 0.05 * i) * span(target), 0.25, 1.0 + i, roll)
            for i, roll in enumerate(rolls)
        ]
    )


def spread_views(target: Target, count: int, seed: int = 4) -> np.ndarray:
    """Poses (count, 4, 4) from which a camera can be calibrated: over the field, tilted, near and far."""
    rng = np.random.default_rng(seed)
    poses = []
    for number in range(count):
        theta = np.radians((5, 30, 50, 62)[number % 4] + rng.uniform(-4, 4))
        azimuth = 2 * np.pi * number / count * 3 + rng.uniform(-0.2, 0.2)
        distance = span(target) * (0.55, 0.75, 1.0)[number % 3]
        poses.append(
            look_pose(target, theta, azimuth, distance, rng.uniform(0.2, 0.7), rng.uniform(0, 6.3), rng.uniform(-3, 3))
        )
    return np.stack(poses)


def imaging(number: int) -> Imaging:
    return replace(IMAGING, seed=100 + number)


def turns(target: Target) -> list[np.ndarray]:
    """Names (n,) that the points bear after each turn by a multiple of 90° that lays them onto themselves."""
    points = target.object_points[:, :2] - (target.object_points.min(axis=0) + target.object_points.max(axis=0))[:2] / 2
    found = []
    for quarter in range(4):
        turned = points @ np.linalg.matrix_power(np.array([[0, 1], [-1, 0]]), quarter)
        distance = np.linalg.norm(turned[:, None] - points, axis=-1)
        if distance.min(axis=1).max() < 1e-9:
            found.append(distance.argmin(axis=1))
    return found


def check_near_truth(camera: FisheyeCamera, pixels: float = 0.15) -> None:
    """Focal lengths, centre and f·r(70°) to so many pixels, E(70°) to 0.05 mm."""
    for name in ("fx", "fy", "cx", "cy"):
        assert abs(getattr(camera, name) - getattr(CAMERA, name)) < pixels, name
    edge = np.radians(70)
    assert abs(camera.fx * camera.radius(edge) - CAMERA.fx * CAMERA.radius(edge)) < pixels
    assert abs(camera.entrance_pupil(edge) - CAMERA.entrance_pupil(edge)) < 0.05e-3
