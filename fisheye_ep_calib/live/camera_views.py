"""What one camera has been shown: the views kept of it, on disk at once, and the counts of its frames."""

from __future__ import annotations

import threading
from dataclasses import dataclass, replace
from enum import Enum
from pathlib import Path

from fisheye_ep_calib.calibration.observations import Observations
from fisheye_ep_calib.errors import CalibrationError
from fisheye_ep_calib.live.frame import Sighting
from fisheye_ep_calib.live.settings import Limits
from fisheye_ep_calib.live.view_store import View, ViewStore, view_of
from fisheye_ep_calib.planning.view_selection import is_new
from fisheye_ep_calib.target import Target


class Verdict(Enum):
    """What became of a frame."""

    KEPT = "kept"
    NOT_NEW = "shows nothing new"
    NOT_FOUND = "no target found"
    TOO_FEW_POINTS = "too few points"
    OTHER_SIZE = "image of another size"
    FULL = "as many views as wanted"
    FORGOTTEN = "from before a reset"
    CHECKED = "held against the calibration"


@dataclass(frozen=True)
class Counters:
    """What happened to this camera's frames since the start."""

    received: int = 0
    dropped: int = 0
    unreadable: int = 0
    searched: int = 0
    detected: int = 0


class CameraViews:
    """The views of one camera; safe to use from several threads. ``generation`` counts resets."""

    def __init__(self, name: str, target: Target, file: Path, limits: Limits | None = None) -> None:
        """file: of the observations."""
        self.name = name
        self.target = target
        self.limits = limits or Limits()
        self._store = ViewStore(file, target)
        self._generation = 0
        self._lock = threading.RLock()  # of both
        self._counting = threading.Lock()  # its own: who counts an image must not wait for the disk
        self._counters = Counters()

    @property
    def generation(self) -> int:
        """Counts resets: what comes of frames or views from before one is dropped."""
        return self._generation

    @property
    def counters(self) -> Counters:
        return self._counters

    @property
    def kept(self) -> tuple[View, ...]:
        return self._store.views

    def number_of(self, name: str) -> int:
        """Which view that is, counted from 1; 0 where it was forgotten meanwhile.

        Names come back where a bag is played again, or a driver stamps nothing: then it is the latest of that name.
        """
        kept = self.kept
        return next((number for number in range(len(kept), 0, -1) if kept[number - 1].name == name), 0)

    @property
    def file(self) -> Path:
        """The observation file."""
        return self._store.path

    @property
    def unwritten(self) -> bool:
        """Whether the disk does not hold all views; looks at the disk."""
        return self._store.unwritten

    @property
    def gone(self) -> bool:
        """Whether the views were on the disk and are there no longer; looks at the disk."""
        return self._store.gone

    @property
    def full(self) -> bool:
        """Whether there are as many views as wanted."""
        return len(self._store.views) >= self.limits.maximum_views

    @property
    def image_size(self) -> tuple[int, int] | None:
        return self._store.image_size

    def start(self, resume: bool) -> int:
        """Take up an earlier run's views, or set its file aside; how many views there are. Raises InputError."""
        with self._lock:
            if resume:
                return self._store.resume()
            self._store.set_aside()
            return 0

    def count(self, **increments: int) -> None:
        """Add to the counters."""
        with self._counting:
            changed = {name: getattr(self._counters, name) + more for name, more in increments.items()}
            self._counters = replace(self._counters, **changed)

    def consider(self, sighting: Sighting, generation: int) -> Verdict:
        """Keep the view if it adds something, and write it down at once. generation: when the frame came.

        Raises CalibrationError where it could not be written; it is kept in memory then.
        """
        self.count(searched=1)
        if len(sighting.detection) == 0:
            return Verdict.NOT_FOUND
        self.count(detected=1)
        view = view_of(sighting, self.target)
        if view is None:
            return Verdict.TOO_FEW_POINTS
        with self._lock:
            store = self._store
            if generation != self._generation:
                return Verdict.FORGOTTEN
            if store.views and store.image_size != sighting.image_size:
                return Verdict.OTHER_SIZE
            if self.full:
                return Verdict.FULL
            if not is_new(view.signature, [kept.signature for kept in store.views], self.limits.novelty):
                return Verdict.NOT_NEW
            store.add(view, sighting.image_size)
        return Verdict.KEPT

    def keep(self, view: View, image_size: tuple[int, int], generation: int) -> bool:
        """Keep a view that another camera's view of the same time needs, however many there are; whether it fits.

        Raises CalibrationError where it could not be written; it is kept in memory then.
        """
        with self._lock:
            if generation != self._generation or (self._store.views and self._store.image_size != image_size):
                return False
            self._store.add(view, image_size)
        return True

    def observations(self) -> Observations:
        """What there is to calibrate from. Raises CalibrationError while there is nothing."""
        with self._lock:
            observations = self._store.observations()
        if observations is None:
            raise CalibrationError("no view of the target yet")
        return observations

    def write(self, again: bool = False) -> None:
        """Write what the disk does not hold; ``again``: also what it does. Raises CalibrationError."""
        with self._lock:
            self._store.write(again)

    def forget(self) -> int:
        """Forget the views; the observation file is set aside. How many they were.

        Raises CalibrationError where the file cannot be renamed; nothing is forgotten then.
        """
        with self._lock:
            forgotten = len(self._store.views)
            self._store.set_aside()
            self._generation += 1
            return forgotten
