"""Many views of one target, rendered in several processes, handed over in order."""

from __future__ import annotations

import multiprocessing
import os
from collections import deque
from collections.abc import Iterator, Sequence
from concurrent.futures import ProcessPoolExecutor
from dataclasses import replace

import cv2
import numpy as np

from fisheye_ep_calib.simulation.rendering import PLAIN, Imaging, render
from fisheye_ep_calib.simulation.scene_camera import SceneCamera
from fisheye_ep_calib.target import Target

_scene: list[tuple[SceneCamera, Target]] = []


def render_views(
    camera: SceneCamera,
    target: Target,
    poses: np.ndarray,
    imaging: Imaging | Sequence[Imaging] = PLAIN,
    processes: int | None = None,
) -> Iterator[np.ndarray]:
    """Images (h, w) uint8 of views at poses (V, 4, 4), in their order.

    imaging: one for each view, or one for all, in which case each view gets a seed of its own.
    processes: how many work at it; None for as many as there are cores, 1 for this one alone.
    """
    if isinstance(imaging, Imaging):
        imaging = [replace(imaging, seed=1000 * imaging.seed + view) for view in range(len(poses))]
    jobs = list(zip(poses, imaging, strict=True))
    processes = min(processes or usable_cores(), len(jobs))
    if processes <= 1:
        yield from (render(camera, target, pose, look) for pose, look in jobs)
        return
    context = multiprocessing.get_context("spawn")
    with ProcessPoolExecutor(processes, context, _prepare, (camera, target)) as pool:
        pending = deque(pool.submit(_render_one, *job) for job in jobs[: 2 * processes])
        for job in jobs[2 * processes :]:
            yield pending.popleft().result()
            pending.append(pool.submit(_render_one, *job))
        while pending:
            yield pending.popleft().result()


def usable_cores() -> int:
    """Cores this process may run on."""
    try:
        return len(os.sched_getaffinity(0))
    except AttributeError:
        return os.cpu_count() or 1


def _prepare(camera: SceneCamera, target: Target) -> None:
    """Set a worker up: every process has one thread, and the scene is sent once."""
    cv2.setNumThreads(1)
    _scene[:] = [(camera, target)]


def _render_one(pose: np.ndarray, imaging: Imaging) -> np.ndarray:
    camera, target = _scene[0]
    return render(camera, target, pose, imaging)
