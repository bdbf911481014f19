"""A rig that is calibrated live: which cameras take part, what it is calibrated from, and what comes of it."""

from __future__ import annotations

import os
import threading
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from fisheye_ep_calib.errors import CalibrationError
from fisheye_ep_calib.live.answer import Answer
from fisheye_ep_calib.live.camera import LiveCamera
from fisheye_ep_calib.live.rig_advice import next_step
from fisheye_ep_calib.live.rig_outcome import RigMember, RigOutcome, calibrate_members
from fisheye_ep_calib.live.rig_views import RigViews, stamp_of
from fisheye_ep_calib.live.settings import RigSettings
from fisheye_ep_calib.live.subject import Basis, Subject, Workplace
from fisheye_ep_calib.live.view_store import observations_of
from fisheye_ep_calib.rig.assembly import MIN_COMMON_VIEWS
from fisheye_ep_calib.rig.graph import components
from fisheye_ep_calib.storage.rig_file import RIG


class LiveRig(Subject[RigOutcome]):
    """Cameras that are fixed to each other, the first one the reference. views: what two or more saw at a time."""

    calibrator = staticmethod(calibrate_members)

    def __init__(
        self,
        cameras: Sequence[LiveCamera],
        topics: Mapping[str, str],
        settings: RigSettings,
        folder: Path,
        workplace: Workplace,
        tell: Callable[[RigOutcome | None], None],
    ) -> None:
        """topics: of the images, by camera. folder: for the rig's files."""
        super().__init__("rig", workplace, tell)
        self.views = RigViews([camera.views for camera in cameras], settings.tolerance, settings.views)
        self._folder = folder
        self._cameras = tuple(cameras)
        self._topics = topics

    @property
    def names(self) -> tuple[str, ...]:
        return tuple(camera.name for camera in self._cameras)

    @property
    def uncalibrated(self) -> tuple[str, ...]:
        """Cameras without a calibration of their own."""
        return tuple(camera.name for camera in self._cameras if camera.outcome is None)

    @property
    def next_step(self) -> str:
        """What would help most, in one sentence."""
        return next_step(self.names, self.views.counts(), self.joined(), self.uncalibrated)

    def joined(self) -> tuple[str, ...]:
        """Cameras that chains of common views join to the reference, itself included."""
        pairs = [(int(a), int(b)) for a, b in np.argwhere(np.triu(self.views.counts(), 1) >= MIN_COMMON_VIEWS)]
        return tuple(self.names[number] for number in components(pairs, len(self.names))[0])

    def basis(self) -> Basis:
        calibrations = tuple(camera.standing.number for camera in self._cameras)
        common = int((self.views.moments()[1] >= 0).sum())
        return Basis(self.views.generation, (self.joined(), common, calibrations))

    def enough(self, basis: Basis) -> bool:
        return not self.uncalibrated and len(self.joined()) > 1

    def arguments(self, basis: Basis) -> tuple[Any, ...]:
        members = self._members(self.joined())
        if len(members) < 2:
            raise CalibrationError(self.next_step)
        unmistakable = all(camera.views.target.unmistakable for camera in self._cameras)
        return members, self.views.tolerance, unmistakable

    def files(self, outcome: RigOutcome) -> Mapping[Path, str]:
        return {self._folder / name: text for name, text in outcome.files.items()}

    def forget_views(self) -> str:
        """The cameras' views are forgotten by the cameras."""
        self.views.forget()
        return "forgotten"

    def save(self, stopping: threading.Event) -> Answer:
        """Calibrate where something is new, and write the files again; waits for both."""
        basis = self.basis()
        if not self.enough(basis):
            return self.summary()
        if self.outcome is None or not self.attempted(basis):
            return self.calibrate().wait(stopping)
        return super().save(stopping)

    def summary(self) -> Answer:
        outcome = self.outcome
        if outcome is None:
            return Answer(True, f"rig: not calibrated yet; {self.next_step}")
        apart = [name for name in self.names if name not in outcome.figures["cameras"]]
        missing = f"; not joined: {', '.join(apart)}; {self.next_step}" if apart else ""
        return Answer(not apart, f"rig: {outcome.summary}, in {self._folder / RIG}{missing}")

    def _members(self, names: Sequence[str]) -> tuple[RigMember, ...]:
        """These cameras with their calibrations and the views that others have too."""
        views, moments = self.views.moments()
        members = []
        for number, camera in enumerate(self._cameras):
            outcome, size = camera.outcome, camera.views.image_size
            chosen = [views[number][row] for row in moments[:, number] if row >= 0]
            if camera.name not in names or outcome is None or size is None or not chosen:
                continue
            stamps = np.array([stamp_of(view.name) for view in chosen], dtype=np.int64)
            file = os.path.relpath(camera.calibration_file, self._folder)
            observations = observations_of(chosen, camera.views.target, size)
            members.append(RigMember(camera.name, outcome, observations, stamps, file, self._topics[camera.name]))
        return tuple(members)
