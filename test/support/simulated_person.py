"""Someone with a board in hand who sees only the page: goes where its outline is, late, not quite, never at rest."""

from __future__ import annotations

import numpy as np
from scipy.optimize import least_squares

from fisheye_ep_calib.camera import FisheyeCamera
from fisheye_ep_calib.planning.detectability import Board
from fisheye_ep_calib.rotation import rotation_from_vector
from fisheye_ep_calib.simulation import look_pose
from fisheye_ep_calib.target import Target

STEPS = 3  # images from one place to the next
_SHAKE_DEG, _SHAKE = 3.0, 0.06  # how far off: each angle, and the place as a share of the distance


class SimulatedPerson:
    """The eye sees the picture through the real lens, so the hand can bring the board's edge onto the outline."""

    def __init__(self, camera: FisheyeCamera, target: Target, seed: int) -> None:
        self._camera = camera
        self._target = target
        self._outline = Board.of(target).outline
        self._rng = np.random.default_rng(seed)
        self._asked: bytes = b""
        self.pose = look_pose(target, 0.2, 0.5, 0.25)
        self._from = self._to = self.pose
        self._step = STEPS

    def look(self, outline_px: list[list[float]] | None) -> None:
        """At the outline that the page shows; where there is none, the board is moved and tilted somehow."""
        if not outline_px or len(outline_px) != len(self._outline):
            if self._step >= STEPS:
                theta, azimuth, tilt, turn = self._rng.uniform([0, -np.pi, 0, -np.pi], [0.9, np.pi, 0.6, np.pi])
                somewhere = look_pose(self._target, theta, azimuth, self._rng.uniform(0.1, 0.3), tilt, turn)
                self._from, self._to, self._step = self.pose, somewhere, 0
            return
        asked = np.array(outline_px)
        if asked.tobytes() != self._asked or self._step >= STEPS + 4:  # not taken: try again, a little differently
            self._asked = asked.tobytes()
            self._from, self._to, self._step = self.pose, self._shaken(self._matching(asked)), 0

    def move(self) -> np.ndarray:
        """The board's pose (4, 4) in the next image."""
        self._step += 1
        share = min(self._step / STEPS, 1.0)
        turn = _between(self._from[:3, :3], self._to[:3, :3])
        pose = np.eye(4)
        pose[:3, :3] = rotation_from_vector(share * turn) @ self._from[:3, :3]
        pose[:3, 3] = (1 - share) * self._from[:3, 3] + share * self._to[:3, 3]
        self.pose = pose
        return pose

    def _matching(self, asked: np.ndarray) -> np.ndarray:
        """The pose at which the lens shows the board's edge on the outline."""

        def off(step: np.ndarray, start: np.ndarray) -> np.ndarray:
            points = self._outline @ _moved(start, step)[:3, :3].T + _moved(start, step)[:3, 3]
            pixels, valid = self._camera.project(points)
            return np.where(valid[:, None], pixels - asked, 300.0).ravel()

        middle = asked.mean(axis=0)
        origin, direction, _ = self._camera.unproject(middle)
        best = None
        for distance in (0.1, 0.2, 0.4):
            start = self.pose.copy()
            start[:3, :3] = _facing(direction)
            start[:3, 3] = origin + distance * direction - start[:3, :3] @ self._outline.mean(axis=0)
            found = least_squares(
                off, np.zeros(6), args=(start,), x_scale=[0.1, 0.1, 0.1, 0.01, 0.01, 0.01], max_nfev=60
            )
            if best is None or found.cost < best[0]:
                best = found.cost, _moved(start, found.x)
        assert best is not None
        return best[1]

    def _shaken(self, pose: np.ndarray) -> np.ndarray:
        distance = float(np.linalg.norm(pose[:3, 3]))
        turn = np.radians(_SHAKE_DEG) * self._rng.normal(size=3)
        return _moved(pose, np.concatenate([turn, _SHAKE * distance / np.sqrt(3) * self._rng.normal(size=3)]))


def _facing(direction: np.ndarray) -> np.ndarray:
    """A board (y down, z away) that looks back along the direction."""
    z = direction / np.linalg.norm(direction)
    x = np.cross([0.0, 1.0, 0.0], z)
    x /= max(np.linalg.norm(x), 1e-9)
    return np.stack([x, np.cross(z, x), z], axis=-1)


def _moved(pose: np.ndarray, step: np.ndarray) -> np.ndarray:
    """Turned about its own place by step[:3] (rad) and moved by step[3:] (m)."""
    moved = pose.copy()
    moved[:3, :3] = rotation_from_vector(step[:3]) @ pose[:3, :3]
    moved[:3, 3] += step[3:]
    return moved


def _between(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    """Rotation vector from a to b."""
    turn = b @ a.T
    angle = np.arccos(np.clip((np.trace(turn) - 1) / 2, -1, 1))
    if angle < 1e-9:
        return np.zeros(3)
    axis = np.array([turn[2, 1] - turn[1, 2], turn[0, 2] - turn[2, 0], turn[1, 0] - turn[0, 1]])
    norm = float(np.linalg.norm(axis))
    return angle * axis / norm if norm > 1e-9 else np.array([angle, 0.0, 0.0])
