"""A camera that is calibrated live: what it is calibrated from, and what comes of it."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

from fisheye_ep_calib.live.answer import Answer
from fisheye_ep_calib.live.camera_views import CameraViews
from fisheye_ep_calib.live.outcome import Outcome, calibrate_views
from fisheye_ep_calib.live.subject import Basis, Subject, Workplace


class LiveCamera(Subject[Outcome]):
    """One camera. views: what it has been shown."""

    calibrator = staticmethod(calibrate_views)

    def __init__(
        self,
        views: CameraViews,
        model: str,
        workplace: Workplace,
        tell: Callable[[Outcome | None], None],
        initial: Outcome | None = None,
    ) -> None:
        """model: to fit. tell, initial: as for every Subject. Its file lies beside that of the views."""
        super().__init__(views.name, workplace, tell, initial)
        self.views = views
        self.camera_file = views.file.with_name(f"{views.name}.yaml")
        self._model = model

    @property
    def unwritten(self) -> bool:
        return self.views.unwritten or super().unwritten

    @property
    def gone(self) -> tuple[Path, ...]:
        return (*((self.views.file,) if self.views.gone else ()), *super().gone)

    @property
    def calibration_file(self) -> Path:
        """The file of the calibration in force."""
        standing = self.standing
        if standing.number or standing.outcome is None:
            return self.camera_file
        return Path(standing.outcome.figures["camera_file"])

    def basis(self) -> Basis:
        return Basis(self.views.generation, len(self.views.kept))

    def enough(self, basis: Basis) -> bool:
        return len(self.views.kept) >= self._workplace.tuning().minimum_views

    def arguments(self, basis: Basis) -> tuple[Any, ...]:
        return self.views.observations(), self._model, self.name, str(self.views.file)

    def objection(self, outcome: Outcome, before: Outcome) -> str:
        return "the calibration from fewer views knows more" if outcome.worse_than(before) else ""

    def files(self, outcome: Outcome) -> Mapping[Path, str]:
        return {self.camera_file: outcome.yaml}

    def write_views(self, again: bool) -> None:
        self.views.write(again)

    def forget_views(self) -> str:
        return f"{self.views.forget()} views set aside"

    def summary(self) -> Answer:
        standing = self.standing
        if standing.outcome is None or not standing.number:
            views = len(self.views.kept)
            return Answer(True, f"{self.name}: {views} views in {self.views.file}, not calibrated yet")
        numbers = "{model}, RMS {rms_px:.3f} px, {views} views, {points} points".format(**standing.outcome.figures)
        return Answer(True, f"{self.name}: {numbers}, in {self.camera_file}")
