"""The rig of a live calibrator: which cameras take part, the calibration in force, its files."""

from __future__ import annotations

import os
import threading
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from fisheye_ep_calib.live.rig_outcome import RigMember, RigOutcome
from fisheye_ep_calib.live.rig_views import RigViews, stamp_of
from fisheye_ep_calib.live.session import CameraSession
from fisheye_ep_calib.live.settings import RigSettings
from fisheye_ep_calib.live.view_store import observations_of
from fisheye_ep_calib.rig.assembly import MIN_COMMON_VIEWS
from fisheye_ep_calib.rig.graph import components
from fisheye_ep_calib.storage.atomic import atomic_write

RIG, CAMCHAIN = "rig.yaml", "camchain.yaml"


@dataclass(frozen=True)
class Basis:
    """What a calibration of the rig rests on; another is due when it changes.

    joined: cameras that common views join to the reference, itself included. calibrations: how many each has had.
    """

    joined: tuple[str, ...]
    generations: tuple[int, ...]
    common_views: int
    calibrations: tuple[int, ...]


class RigSession:
    """The cameras of a rig, the first one its reference; safe to use from several threads."""

    def __init__(
        self,
        sessions: Sequence[CameraSession],
        topics: Mapping[str, str],
        settings: RigSettings,
        folder: Path,
    ) -> None:
        """topics: of the images, by camera."""
        self.views = RigViews(sessions, settings.tolerance, settings.views)
        self.rig_file, self.camchain_file = folder / RIG, folder / CAMCHAIN
        self._sessions = {session.name: session for session in sessions}
        self._topics = topics
        self._lock = threading.RLock()
        self._outcome: RigOutcome | None = None
        self._unwritten = False

    @property
    def names(self) -> tuple[str, ...]:
        return tuple(self._sessions)

    @property
    def outcome(self) -> RigOutcome | None:
        """The calibration in force."""
        return self._outcome

    @property
    def unwritten(self) -> bool:
        """Whether something waits to be written because the disk refused it."""
        return self._unwritten

    @property
    def uncalibrated(self) -> tuple[str, ...]:
        """Cameras without a calibration of their own."""
        return tuple(name for name, session in self._sessions.items() if session.outcome is None)

    def joined(self) -> tuple[str, ...]:
        """Cameras that chains of common views join to the reference, itself included."""
        counts = self.views.counts()
        pairs = [(int(a), int(b)) for a, b in np.argwhere(np.triu(counts, 1) >= MIN_COMMON_VIEWS)]
        return tuple(self.names[number] for number in components(pairs, len(self.names))[0])

    def generations(self) -> tuple[int, ...]:
        return tuple(session.generation for session in self._sessions.values())

    def basis(self) -> Basis:
        """What there is to calibrate from now."""
        calibrations = tuple(session.calibrations for session in self._sessions.values())
        common = int((self.views.moments()[1] >= 0).sum())
        return Basis(self.joined(), self.generations(), common, calibrations)

    def members(self, names: Sequence[str]) -> tuple[RigMember, ...]:
        """These cameras with their calibrations and the views that others have too."""
        views, moments = self.views.moments()
        members = []
        for number, (name, session) in enumerate(self._sessions.items()):
            outcome, size = session.outcome, session.image_size
            chosen = [views[number][row] for row in moments[:, number] if row >= 0]
            if name not in names or outcome is None or size is None or not chosen:
                continue
            stamps = np.array([stamp_of(view.name) for view in chosen], dtype=np.int64)
            file = os.path.relpath(session.calibration_file, self.rig_file.parent)
            observations = observations_of(chosen, session.target, size)
            members.append(RigMember(name, outcome, observations, stamps, file, self._topics[name]))
        return tuple(members)

    @property
    def unmistakable(self) -> bool:
        """Whether no detector can take the target for itself turned."""
        return all(session.target.unmistakable for session in self._sessions.values())

    def adopt(self, outcome: RigOutcome, generations: tuple[int, ...]) -> bool:
        """Put a calibration into force; False where views that it came from were thrown away meanwhile."""
        with self._lock:
            if generations != self.generations():
                return False
            self._outcome, self._unwritten = outcome, True
            return True

    def forget(self) -> None:
        """The cameras' views are gone."""
        with self._lock:
            self._outcome, self._unwritten = None, False
        self.views.forget()

    def write(self, again: bool = False) -> None:
        """Write what is not on disk yet; ``again``: also what is. Raises CalibrationError."""
        with self._lock:
            if self._outcome is not None and (self._unwritten or again):
                atomic_write(self.rig_file, self._outcome.yaml.encode())
                atomic_write(self.camchain_file, self._outcome.camchain.encode())
            self._unwritten = False
