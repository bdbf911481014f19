"""Many views, rendered in several processes and handed over in order; and bags of several cameras made of them."""

from __future__ import annotations

import multiprocessing
from collections import deque
from collections.abc import Iterable, Iterator, Sequence
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass, replace

import cv2
import numpy as np

from fisheye_ep_calib.simulation.bag import StampedImage
from fisheye_ep_calib.simulation.rendering import PLAIN, Imaging, render
from fisheye_ep_calib.simulation.scene_camera import SceneCamera
from fisheye_ep_calib.target import Target
from fisheye_ep_calib.worker_processes import inherited_by_workers, usable_cores

_views: list[View] = []


@dataclass(frozen=True)
class View:
    """One image to render; pose (4, 4) is camera_from_target."""

    camera: SceneCamera
    target: Target
    pose: np.ndarray
    imaging: Imaging = PLAIN

    def render(self) -> np.ndarray:
        return render(self.camera, self.target, self.pose, self.imaging)


@dataclass(frozen=True)
class SimulatedCamera:
    """A camera of a rig and what it is shown: its topic is /NAME/image_raw, its frame NAME_optical_frame.

    views: one image each, all cameras in step.
    """

    name: str
    views: tuple[View, ...]


def views_at(camera: SceneCamera, target: Target, poses: np.ndarray, imaging: Imaging = PLAIN) -> tuple[View, ...]:
    """Views at poses (V, 4, 4), each with noise of its own."""
    return tuple(
        View(camera, target, pose, replace(imaging, seed=1000 * imaging.seed + number))
        for number, pose in enumerate(poses)
    )


def render_views(views: Sequence[View], processes: int | None = None) -> Iterator[np.ndarray]:
    """Images (h, w) uint8 of views, in their order.

    processes: how many work at it; None for as many as there are cores, 1 for this one alone.
    """
    processes = min(processes or usable_cores(), len(views))
    if processes <= 1:
        yield from (view.render() for view in views)
        return
    context = multiprocessing.get_context("spawn")
    with ProcessPoolExecutor(processes, context, _prepare, (list(views),)) as pool:
        ahead = 2 * processes
        with inherited_by_workers():
            pending = deque(pool.submit(_render, number) for number in range(min(ahead, len(views))))
        for number in range(len(views)):
            yield pending.popleft().result()
            if number + ahead < len(views):
                pending.append(pool.submit(_render, number + ahead))


def simulate_rig(
    cameras: Sequence[SimulatedCamera],
    rate: float,
    start_ns: int,
    compression: str = "",
    processes: int | None = None,
) -> Iterator[StampedImage]:
    """The images of several cameras, in order of time: view i of every camera at start_ns + i/rate (rate in Hz)."""
    count = max(len(camera.views) for camera in cameras)
    order = [
        (camera.name, start_ns + round(number * 1e9 / rate), camera.views[number])
        for number in range(count)
        for camera in cameras
        if number < len(camera.views)
    ]
    images: Iterable[np.ndarray] = render_views([view for _, _, view in order], processes)
    suffix = "/compressed" if compression else ""
    for (name, stamp_ns, _), image in zip(order, images, strict=True):
        topic = f"/{name}/image_raw{suffix}"
        yield StampedImage(topic, stamp_ns, f"{name}_optical_frame", image, compression)


def _prepare(views: list[View]) -> None:
    """Set a worker up: every process has one thread, and the scene is sent once."""
    cv2.setNumThreads(1)
    _views[:] = views


def _render(number: int) -> np.ndarray:
    return _views[number].render()
