"""One camera being calibrated live: its views, its counters and its latest result."""

from __future__ import annotations

import threading
from dataclasses import dataclass, replace
from enum import Enum
from pathlib import Path

from fisheye_ep_calib.calibration.observations import Observations
from fisheye_ep_calib.errors import CalibrationError
from fisheye_ep_calib.live.frame import Sighting
from fisheye_ep_calib.live.outcome import Outcome
from fisheye_ep_calib.live.view_store import View, ViewStore, view_of
from fisheye_ep_calib.planning.view_selection import Novelty, is_new
from fisheye_ep_calib.storage.atomic import atomic_write
from fisheye_ep_calib.target import Target


class Verdict(Enum):
    """What became of a frame."""

    KEPT = "kept"
    NOT_NEW = "shows nothing new"
    NOT_FOUND = "no target found"
    TOO_FEW_POINTS = "too few points"
    OTHER_SIZE = "image of another size"
    FULL = "as many views as wanted"


@dataclass(frozen=True)
class Limits:
    """When a view is kept. maximum_views: after so many, no more are."""

    novelty: Novelty = Novelty()
    maximum_views: int = 150


@dataclass(frozen=True)
class Counters:
    """What happened to this camera's frames since the start."""

    received: int = 0
    dropped: int = 0
    unreadable: int = 0
    searched: int = 0
    found: int = 0


class CameraSession:
    """Everything known about one camera; safe to use from several threads."""

    def __init__(
        self,
        name: str,
        target: Target,
        folder: Path,
        limits: Limits | None = None,
        initial: Outcome | None = None,
    ) -> None:
        """initial: a calibration made before, in force until there is a better one and after a reset."""
        self.name = name
        self.target = target
        self.camera_file = folder / f"{name}.yaml"
        self.limits = limits or Limits()
        self._store = ViewStore(folder / f"{name}.npz", target)
        self._lock = threading.RLock()
        self._counting = threading.Lock()  # its own: who counts an image must not wait for the disk
        self._counters = Counters()
        self._initial = self._outcome = initial
        self._outcome_unwritten = False
        self._generation = self._calibrations = 0

    @property
    def counters(self) -> Counters:
        return self._counters

    @property
    def views(self) -> tuple[View, ...]:
        return self._store.views

    @property
    def outcome(self) -> Outcome | None:
        """The calibration in force."""
        return self._outcome

    @property
    def observation_file(self) -> Path:
        return self._store.path

    @property
    def unwritten(self) -> bool:
        """Whether something waits to be written because the disk refused it."""
        return self._store.unwritten or self._outcome_unwritten

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

    def consider(self, sighting: Sighting) -> Verdict:
        """Keep the view if it adds something, and write it down at once.

        Raises CalibrationError where it could not be written; it is kept in memory then.
        """
        self.count(searched=1)
        if len(sighting.detection) == 0:
            return Verdict.NOT_FOUND
        self.count(found=1)
        view = view_of(sighting, self.target)
        if view is None:
            return Verdict.TOO_FEW_POINTS
        with self._lock:
            store = self._store
            if store.views and store.image_size != sighting.image_size:
                return Verdict.OTHER_SIZE
            if self.full:
                return Verdict.FULL
            if not is_new(view.signature, [kept.signature for kept in store.views], self.limits.novelty):
                return Verdict.NOT_NEW
            store.add(view, sighting.image_size)
        return Verdict.KEPT

    def keep(self, view: View, image_size: tuple[int, int]) -> bool:
        """Keep a view that another camera's view of the same time needs, however many there are; whether it fits.

        Raises CalibrationError where it could not be written; it is kept in memory then.
        """
        with self._lock:
            if self._store.views and self._store.image_size != image_size:
                return False
            self._store.add(view, image_size)
        return True

    @property
    def generation(self) -> int:
        """Counts resets: what comes of views or frames from before one is dropped."""
        return self._generation

    @property
    def calibrations(self) -> int:
        """How many calibrations have come into force."""
        return self._calibrations

    @property
    def calibration_file(self) -> Path:
        """The file of the calibration in force."""
        if self.calibrated or self._outcome is None:
            return self.camera_file
        return Path(self._outcome.figures["camera_file"])

    def observations(self) -> Observations:
        """What there is to calibrate from. Raises CalibrationError while there is nothing."""
        with self._lock:
            observations = self._store.observations()
        if observations is None:
            raise CalibrationError("no view of the target yet")
        return observations

    @property
    def calibrated(self) -> bool:
        """Whether the calibration in force comes from this session's views."""
        return self._outcome is not self._initial

    def adopt(self, outcome: Outcome, generation: int) -> bool:
        """Put a calibration into force; False where the views it came from were thrown away meanwhile."""
        with self._lock:
            if generation != self._generation:
                return False
            self._outcome, self._outcome_unwritten = outcome, True
            self._calibrations += 1
            return True

    def write(self, again: bool = False) -> None:
        """Write what is not on disk yet; ``again``: also what is. Raises CalibrationError."""
        with self._lock:
            self._store.write(again)
            if self._outcome is not None and (self._outcome_unwritten or (again and self.calibrated)):
                atomic_write(self.camera_file, self._outcome.yaml.encode())
            self._outcome_unwritten = False

    def reset(self) -> int:
        """Forget views and calibration; the observation file is set aside. How many views were forgotten.

        Raises CalibrationError where the file cannot be renamed; nothing is forgotten then.
        """
        with self._lock:
            forgotten = len(self._store.views)
            self._store.set_aside()
            self._generation += 1
            self._outcome, self._outcome_unwritten = self._initial, False
            return forgotten
