"""Boards that are not what their file says: bent, wavy, with a lifted corner, stretched, badly printed."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from known_scenes import BOARD, CAMERA, poses_of, seen

from fisheye_ep_calib.calibration import Observations
from fisheye_ep_calib.camera import FisheyeCamera


def bent(points: np.ndarray, kind: str, amount: float, seed: int = 0) -> np.ndarray:
    """Points (n, 3) of a board in z = 0, bent by an amount in metres ("stretched": a share), size and place kept.

    kind: "bow", "wave", "corner", "stretched" or "jitter".
    """
    rng = np.random.default_rng([seed, 21])
    middle = points.mean(axis=0)
    x, y = ((points - middle) / np.abs(points - middle).max(axis=0).clip(1e-9)).T[:2]
    change = np.zeros_like(points)
    if kind == "bow":
        change[:, 2] = amount * (1 - x**2 - 0.5 * y**2)
    elif kind == "wave":
        phase = rng.uniform(0, 2 * np.pi, 2)
        change[:, 2] = amount * np.sin(5 * x + phase[0]) * np.cos(2.2 * y + phase[1])
    elif kind == "corner":
        change[:, 2] = amount * np.maximum((x + y) / 2 - 0.35, 0) / 0.65
    elif kind == "stretched":
        change[:, 0] = amount * (points - middle)[:, 0]
    else:
        change = rng.normal(0, amount, points.shape)
    moved = points + change
    arms, nominal = moved - moved.mean(axis=0), points - middle
    return moved.mean(axis=0) + arms * np.sqrt((nominal**2).sum() / (arms**2).sum())


def seen_bent(
    kind: str, amount: float, views: int = 20, noise: float = 0.1, seed: int = 1, camera: FisheyeCamera = CAMERA
) -> tuple[Observations, np.ndarray]:
    """What a camera sees of a bent board whose file knows nothing of it, and its true points (n, 3)."""
    true = bent(BOARD.object_points, kind, amount, seed)
    observations = seen(camera, true, poses_of(views, seed), noise, seed)
    return replace(observations, object_points=BOARD.object_points), true


def aligned(points: np.ndarray, onto: np.ndarray) -> np.ndarray:
    """Points (n, 3) turned and moved onto others (Kabsch)."""
    left, _, right = np.linalg.svd((onto - onto.mean(axis=0)).T @ (points - points.mean(axis=0)))
    turn = left @ np.diag([1, 1, np.linalg.det(left @ right)]) @ right
    return (points - points.mean(axis=0)) @ turn.T + onto.mean(axis=0)
