"""A camera that is calibrated live: what it is calibrated from, and what comes of it."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any

from fisheye_ep_calib.errors import CalibrationError
from fisheye_ep_calib.live.advice import Wanted, first_plan
from fisheye_ep_calib.live.answer import Answer, Promise
from fisheye_ep_calib.live.camera_views import CameraViews, Verdict
from fisheye_ep_calib.live.check import Check
from fisheye_ep_calib.live.frame import Sighting
from fisheye_ep_calib.live.guide import Guide
from fisheye_ep_calib.live.look import Looks
from fisheye_ep_calib.live.other_board import OtherBoard
from fisheye_ep_calib.live.outcome import Outcome, calibrate_views
from fisheye_ep_calib.live.report_page import report_page
from fisheye_ep_calib.live.seeing import Seeing
from fisheye_ep_calib.live.settings import RELATIVE_GOAL, Tuning
from fisheye_ep_calib.live.subject import Basis, Subject, Workplace
from fisheye_ep_calib.live.view_store import view_of
from fisheye_ep_calib.live.work_pool import Task
from fisheye_ep_calib.planning.detectability import Board
from fisheye_ep_calib.storage.atomic import atomic_write

_FRAMES_A_PLAN = 10  # before the first calibration; the more is seen, the better is the plan


class LiveCamera(Subject[Outcome]):
    """One camera. views: what it has been shown. seeing: how far and how sharply it sees. guide: what it asks for.

    looks: what became of its frames. other_board: what is seen while the target is not.
    """

    calibrator = staticmethod(calibrate_views)

    def __init__(
        self,
        views: CameraViews,
        model: str,
        workplace: Workplace,
        tell: Callable[[Outcome | None], None],
        initial: Outcome | None = None,
        check: Check | None = None,
        options: Mapping[str, Any] | None = None,
    ) -> None:
        """model: to fit. options: of the calibration. tell, initial: as for every Subject.

        check: holds what is seen against ``initial``; nothing is calibrated then. The camera's file lies beside that of
        the views.
        """
        super().__init__(views.name, workplace, tell, initial)
        self.views = views
        self.check = check
        self.camera_file = views.file.with_name(f"{views.name}.yaml")
        self.seeing, self.guide, self.looks, self.other_board = Seeing(), Guide(), Looks(), OtherBoard()
        self._model, self._options = model, dict(options or {})
        self._board = Board.of(views.target)

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
        return self.check is None and len(self.views.kept) >= self._workplace.tuning().minimum_views

    def arguments(self, basis: Basis) -> tuple[Any, ...]:
        if self.check is not None:
            raise CalibrationError("the camera is only checked: set `check` to false to calibrate it")
        observations = self.views.observations()
        sight, tried = self.seeing.sight(), self.guide.tried
        return observations, self._model, self.name, str(self.views.file), self._board, sight, tried, self._options

    def objection(self, outcome: Outcome, before: Outcome) -> str:
        return "the calibration from fewer views knows more" if outcome.worse_than(before) else ""

    def files(self, outcome: Outcome) -> Mapping[Path, str]:
        return {self.camera_file: outcome.yaml}

    def write_views(self, again: bool) -> None:
        self.views.write(again)

    def forget_views(self) -> str:
        forgotten = f"{self.views.forget()} views set aside"
        self.guide.forget()
        self.seeing.forget()
        self.other_board.forget()
        return forgotten

    def report(self) -> Promise:
        """Have a report of all views made and written beside the camera file; the promise's answer comes then."""
        promise = Promise()
        path = self.camera_file.with_name(f"{self.name}_report.html")

        def done(page: str | None, error: CalibrationError | None) -> None:
            try:
                if page is None:
                    promise.answer = Answer(False, f"{self.name}: {error}")
                    return
                atomic_write(path, page.encode())
                promise.answer = Answer(True, f"{self.name}: report in {path}")
            except CalibrationError as failure:
                promise.answer = Answer(False, f"{self.name}: {failure}")
            finally:
                promise.ready.set()

        task = Task(report_page, lambda: (self.views.observations(), self._model, self.name), done)
        self._workplace.pool.queue_job(task)
        return promise

    def searched(self, sighting: Sighting, verdict: Verdict) -> None:
        """A frame was searched: go on to the next pose where this one is reached."""
        self.other_board.take(sighting)
        self.looks.take(sighting, verdict)
        if self.views.image_size not in (None, sighting.image_size):  # it says nothing of what the kept views show
            self.guide.searched(None)
            return
        self.seeing.take(sighting)
        outcome = self.outcome
        due = self.looks.last.number % _FRAMES_A_PLAN == 1
        if due and (outcome is None or outcome.advice is None):
            camera = None if outcome is None else outcome.camera
            self.follow(first_plan(self.views.target, sighting.image_size, self.seeing.sight(), camera))
        view = view_of(sighting, self.views.target) if len(sighting.detection) else None
        self.guide.searched(None if view is None else view.signature)

    def follow(self, plan: Sequence[Wanted]) -> None:
        """Ask for these poses, but for those that kept views show."""
        self.guide.follow(plan, [view.signature for view in self.views.kept])

    def reached(self, tuning: Tuning) -> bool:
        """Whether the goal is: E known as well as wanted, and nothing open that showing the target could end."""
        outcome = self.outcome
        if outcome is None or outcome.advice is None or outcome.advice.lacking:
            return False
        if tuning.goal_mm > 0:
            return outcome.pupil_band_mm <= tuning.goal_mm
        return outcome.advice.against_guided <= RELATIVE_GOAL

    def summary(self) -> Answer:
        standing = self.standing
        if standing.outcome is None or not standing.number:
            views = len(self.views.kept)
            return Answer(True, f"{self.name}: {views} views in {self.views.file}, not calibrated yet")
        numbers = "{model}, RMS {rms_px:.3f} px, {views} views, {points} points".format(**standing.outcome.figures)
        return Answer(True, f"{self.name}: {numbers}, in {self.camera_file}")
