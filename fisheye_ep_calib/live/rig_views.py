"""Views of several cameras that were taken at the same time: which there are, and which to keep for the rig."""

from __future__ import annotations

import threading
from collections import deque
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from fisheye_ep_calib.errors import InputError
from fisheye_ep_calib.live.camera_views import CameraViews
from fisheye_ep_calib.live.frame import Sighting
from fisheye_ep_calib.live.view_store import View, view_of
from fisheye_ep_calib.planning.view_selection import is_new
from fisheye_ep_calib.rig import stamps_of_names
from fisheye_ep_calib.rig.synchronisation import simultaneous

RECENT = 8  # sightings that each camera's later partners are compared with


@dataclass
class _Seen:
    """What one camera saw lately. generation: of its views then. kept: whether it is among the camera's views."""

    stamp_ns: int
    view: View
    image_size: tuple[int, int]
    generation: int
    kept: bool


@dataclass(frozen=True)
class Partner:
    """A view that shows its own camera nothing new, to be kept for the rig. generation: of the camera's views."""

    camera: str
    view: View
    image_size: tuple[int, int]
    generation: int


def stamp_of(name: str) -> int | None:
    """Nanoseconds from a frame's name, seconds.nanoseconds; None where it is called otherwise."""
    try:
        return int(stamps_of_names([name])[0])
    except InputError:
        return None


def common_moments(views: Sequence[Sequence[View]], tolerance_ns: int) -> np.ndarray:
    """Moments (m, cameras) that two cameras or more saw, in the order of time: numbers of views, −1 for none."""
    numbers, stamps = [], []
    for of_camera in views:
        stamped = [
            (number, stamp) for number, view in enumerate(of_camera) if (stamp := stamp_of(view.name)) is not None
        ]
        numbers.append(np.array([number for number, _ in stamped], dtype=int))
        stamps.append(np.array([stamp for _, stamp in stamped], dtype=np.int64))
    rows = simultaneous(stamps, tolerance_ns)
    rows = rows[(rows >= 0).sum(axis=1) > 1]
    moments = np.full_like(rows, -1)
    for camera, number in enumerate(numbers):
        has = rows[:, camera] >= 0
        moments[has, camera] = number[rows[has, camera]]
    result: np.ndarray = moments
    return result


class RigViews:
    """The common views of a rig's cameras; safe to use from several threads.

    Under ``_lock``: what each camera saw lately, and the moments that the cameras' views at one time make. Which
    cameras want common views is replaced as a whole and read without it, where images are received.
    """

    def __init__(self, cameras: Sequence[CameraViews], tolerance: float, most: int) -> None:
        """tolerance: seconds within which images are of the same time. most: common views wanted of two cameras."""
        self.tolerance = tolerance
        self._tolerance_ns = round(tolerance * 1e9)
        self._cameras = {camera.name: camera for camera in cameras}
        self._most = most
        self._lock = threading.RLock()
        self._recent: dict[str, deque[_Seen]] = {name: deque(maxlen=RECENT) for name in self._cameras}
        self._moments: tuple[tuple[tuple[View, ...], ...], np.ndarray] | None = None
        self._wanting: frozenset[str] = frozenset()
        self._find_who_wants()

    @property
    def generation(self) -> tuple[int, ...]:
        """Of the cameras' views."""
        return tuple(camera.generation for camera in self._cameras.values())

    def moments(self) -> tuple[tuple[tuple[View, ...], ...], np.ndarray]:
        """Each camera's views, and the moments (m, cameras) that two or more of them saw (``common_moments``)."""
        views = tuple(camera.kept for camera in self._cameras.values())
        with self._lock:
            if self._moments is None or any(a is not b for a, b in zip(self._moments[0], views, strict=True)):
                self._moments = views, common_moments(views, self._tolerance_ns)
            return self._moments

    def counts(self) -> np.ndarray:
        """Common views (cameras, cameras) of each two."""
        takes_part = (self.moments()[1] >= 0).astype(int)
        result: np.ndarray = takes_part.T @ takes_part
        return result

    def wants(self, name: str) -> bool:
        """Whether this camera and another one had fewer common views than are wanted, when one last saw the target."""
        return name in self._wanting

    def partners(self, name: str, sighting: Sighting, generation: int, kept: bool) -> list[Partner]:
        """What to keep for the rig, now that a camera saw this: of this camera and of those that saw it as well.

        Two views of the same time are worth it where, among the common views of their cameras, either is new.
        generation: of the camera's views, when the frame came. kept: whether the view is among them.
        """
        camera = self._cameras[name]
        stamp, view = stamp_of(sighting.name), view_of(sighting, camera.target)
        if stamp is None or view is None:
            return []
        with self._lock:
            kept = kept or _has(camera, view.name)
            latest = _Seen(stamp, view, sighting.image_size, generation, kept)
            self._recent[name].append(latest)
            chosen = []
            for other in self._recent.keys() - {name}:
                partner = self._nearest(other, stamp)
                if (
                    partner is None
                    or (partner.kept and latest.kept)
                    or not self._new_together(name, latest, other, partner)
                ):
                    continue
                for camera_name, recent in ((name, latest), (other, partner)):
                    if not recent.kept:
                        recent.kept = True
                        chosen.append(Partner(camera_name, recent.view, recent.image_size, recent.generation))
            self._find_who_wants()
            return chosen

    def forget(self) -> None:
        """The cameras' views are gone."""
        with self._lock:
            for recent in self._recent.values():
                recent.clear()
            self._find_who_wants()

    def _find_who_wants(self) -> None:
        counts = self.counts()
        np.fill_diagonal(counts, self._most)
        self._wanting = frozenset(
            name for name, of_camera in zip(self._cameras, counts, strict=True) if (of_camera < self._most).any()
        )

    def _nearest(self, camera: str, stamp_ns: int) -> _Seen | None:
        near = [recent for recent in self._recent[camera] if abs(recent.stamp_ns - stamp_ns) <= self._tolerance_ns]
        return min(near, key=lambda recent: abs(recent.stamp_ns - stamp_ns), default=None)

    def _new_together(self, a: str, of_a: _Seen, b: str, of_b: _Seen) -> bool:
        views, moments = self.moments()
        numbers = {name: number for number, name in enumerate(self._cameras)}
        common = moments[(moments[:, [numbers[a], numbers[b]]] >= 0).all(axis=1)]
        if len(common) >= self._most:
            return False
        return any(
            is_new(
                recent.view.signature,
                [views[numbers[name]][row].signature for row in common[:, numbers[name]]],
                self._cameras[name].limits.novelty,
            )
            for name, recent in ((a, of_a), (b, of_b))
        )


def _has(camera: CameraViews, name: str) -> bool:
    """A bag in a loop shows the same frames again."""
    return any(view.name == name for view in camera.kept)
