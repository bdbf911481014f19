"""Views of several cameras that were taken at the same time: which there are, and which to keep for the rig."""

from __future__ import annotations

import threading
from collections import deque
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from fisheye_ep_calib.errors import InputError
from fisheye_ep_calib.live.frame import Sighting
from fisheye_ep_calib.live.session import CameraSession
from fisheye_ep_calib.live.view_store import View, view_of
from fisheye_ep_calib.planning.view_selection import is_new
from fisheye_ep_calib.rig import stamps_of_names
from fisheye_ep_calib.rig.synchronisation import simultaneous

RECENT = 8  # sightings that each camera's later partners are compared with


@dataclass
class _Seen:
    """What one camera saw lately. kept: whether it is among the camera's views."""

    stamp_ns: int
    view: View
    image_size: tuple[int, int]
    kept: bool


@dataclass(frozen=True)
class Partner:
    """A view that shows its own camera nothing new, to be kept for the rig."""

    camera: str
    view: View
    image_size: tuple[int, int]


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
        known = [(number, stamp) for number, view in enumerate(of_camera) if (stamp := stamp_of(view.name)) is not None]
        numbers.append(np.array([number for number, _ in known], dtype=int))
        stamps.append(np.array([stamp for _, stamp in known], dtype=np.int64))
    found = simultaneous(stamps, tolerance_ns)
    found = found[(found >= 0).sum(axis=1) > 1]
    moments = np.full_like(found, -1)
    for camera, number in enumerate(numbers):
        has = found[:, camera] >= 0
        moments[has, camera] = number[found[has, camera]]
    return moments


class RigViews:
    """The common views of a rig's cameras; safe to use from several threads."""

    def __init__(self, sessions: Sequence[CameraSession], tolerance: float, most: int) -> None:
        """tolerance: seconds within which images are of the same time. most: common views wanted of two cameras."""
        self.tolerance = tolerance
        self._sessions = tuple(sessions)
        self._number = {session.name: number for number, session in enumerate(sessions)}
        self._most = most
        self._lock = threading.RLock()
        self._recent: dict[str, deque[_Seen]] = {session.name: deque(maxlen=RECENT) for session in sessions}
        self._known: tuple[tuple[tuple[View, ...], ...], np.ndarray] | None = None

    @property
    def tolerance_ns(self) -> int:
        return round(self.tolerance * 1e9)

    def moments(self) -> tuple[tuple[tuple[View, ...], ...], np.ndarray]:
        """Each camera's views, and the moments (m, cameras) that two or more of them saw."""
        views = tuple(session.views for session in self._sessions)
        with self._lock:
            if self._known is None or any(a is not b for a, b in zip(self._known[0], views, strict=True)):
                self._known = views, common_moments(views, self.tolerance_ns)
            return self._known

    def counts(self) -> np.ndarray:
        """Common views (cameras, cameras) of each two."""
        seen = (self.moments()[1] >= 0).astype(int)
        return seen.T @ seen

    def wants(self, name: str) -> bool:
        """Whether two cameras, this one among them, have fewer common views than are wanted."""
        number = self._number[name]
        return bool((np.delete(self.counts()[number], number) < self._most).any())

    def partners(self, name: str, sighting: Sighting, kept: bool) -> list[Partner]:
        """What to keep for the rig, now that a camera saw this: of this camera and of those that saw it as well.

        Two views of the same time are worth it where, among the common views of their cameras, either is new.
        """
        session = self._sessions[self._number[name]]
        stamp, view = stamp_of(sighting.name), view_of(sighting, session.target)
        if stamp is None or view is None:
            return []
        with self._lock:
            latest = _Seen(stamp, view, sighting.image_size, kept or _has(session, view.name))
            self._recent[name].append(latest)
            chosen = []
            for other in self._recent.keys() - {name}:
                seen = self._nearest(other, stamp)
                if seen is None or (seen.kept and latest.kept) or not self._new_together(name, latest, other, seen):
                    continue
                for camera, one in ((name, latest), (other, seen)):
                    if not one.kept:
                        one.kept = True
                        chosen.append(Partner(camera, one.view, one.image_size))
            return chosen

    def forget(self) -> None:
        """The sessions have been reset."""
        with self._lock:
            for recent in self._recent.values():
                recent.clear()

    def _nearest(self, camera: str, stamp_ns: int) -> _Seen | None:
        near = [seen for seen in self._recent[camera] if abs(seen.stamp_ns - stamp_ns) <= self.tolerance_ns]
        return min(near, key=lambda seen: abs(seen.stamp_ns - stamp_ns), default=None)

    def _new_together(self, a: str, of_a: _Seen, b: str, of_b: _Seen) -> bool:
        views, moments = self.moments()
        i, j = self._number[a], self._number[b]
        common = moments[(moments[:, [i, j]] >= 0).all(axis=1)]
        if len(common) >= self._most:
            return False
        return any(
            is_new(
                seen.view.signature,
                [views[number][row].signature for row in common[:, number]],
                self._sessions[number].limits.novelty,
            )
            for number, seen in ((i, of_a), (j, of_b))
        )


def _has(session: CameraSession, name: str) -> bool:
    """A bag in a loop shows the same frames again."""
    return any(view.name == name for view in session.views)
