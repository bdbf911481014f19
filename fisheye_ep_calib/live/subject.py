"""What is calibrated live, a camera or a rig: its calibrations, the one in force, and its files.

What it is calibrated from, the views, belongs to the subject's kind and has a lock of its own. Here:

    standing            what is in force; replaced as a whole under ``_lock``, read without it
    begun, attempted,   under ``_lock``: how many calibrations have begun, what the last one rested on, whether an
    busy, under_way     automatic one waits or runs, and all that wait or run
    adopting, resetting under ``_telling``, from looking at the generation until the listener has been told, so that the
                        listener hears of calibrations in the order in which they come into force
    files               under ``_writing``, which a reset takes too: no file appears after it

Locks are taken in this order: ``_telling``, ``_writing``, the views' own, ``_lock``.
"""

from __future__ import annotations

import threading
from abc import ABC, abstractmethod
from collections.abc import Callable, Hashable, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Generic, TypeVar

from fisheye_ep_calib.errors import CalibrationError
from fisheye_ep_calib.live.announcer import Announcer
from fisheye_ep_calib.live.answer import Answer, Promise
from fisheye_ep_calib.live.settings import Tuning
from fisheye_ep_calib.live.work_pool import Task, WorkPool
from fisheye_ep_calib.storage.kept_file import KeptFile

Result = TypeVar("Result")

_RESET = "its views were reset meanwhile"


@dataclass(frozen=True)
class Workplace:
    """What subjects share. tuning: as it is now. ended: called when a calibration has ended, whatever came of it."""

    pool: WorkPool
    announcer: Announcer
    tuning: Callable[[], Tuning]
    ended: Callable[[], None]


@dataclass(frozen=True)
class Basis:
    """What a calibration rests on; another is due when it changes. generation: of the views."""

    generation: Hashable
    extent: Hashable


@dataclass(frozen=True)
class Standing(Generic[Result]):
    """What is in force. number: which calibration of all that have begun; 0: it was there before. files: to write."""

    outcome: Result | None
    number: int = 0
    files: tuple[KeptFile, ...] = ()


@dataclass
class _Attempt:
    """A calibration from its being queued to its end. number, basis: once it has begun.

    asked: somebody waits for it. automatic: it was not asked for at first.
    """

    asked: bool
    generation: Hashable
    number: int = 0
    basis: Basis | None = None
    automatic: bool = False
    promise: Promise = field(default_factory=Promise)


class Subject(ABC, Generic[Result]):
    """A camera or a rig; safe to use from several threads. Methods return at once unless they say otherwise."""

    calibrator: Callable[..., Any]  # what a worker process runs on ``arguments``; gives a Result

    def __init__(
        self, name: str, workplace: Workplace, tell: Callable[[Result | None], None], initial: Result | None = None
    ) -> None:
        """tell: told of each calibration that comes into force; None: there is none any more.

        initial: a calibration made before, in force until there is a better one and after a reset.
        """
        self.name = name
        self._workplace = workplace
        self._tell = tell
        self._initial: Standing[Result] = Standing(initial)
        self._standing = self._initial
        self._begun = 0
        self._attempted: Basis | None = None
        self._busy = False
        self._under_way: list[_Attempt] = []
        self._lock = threading.Lock()
        self._telling = threading.RLock()
        self._writing = threading.RLock()

    @abstractmethod
    def basis(self) -> Basis:
        """What there is to calibrate from now."""

    @abstractmethod
    def enough(self, basis: Basis) -> bool:
        """Whether it is enough to calibrate without being asked."""

    @abstractmethod
    def arguments(self, basis: Basis) -> tuple[Any, ...]:
        """For ``calibrator``. Raises CalibrationError where there is too little."""

    @abstractmethod
    def files(self, outcome: Result) -> Mapping[Path, str]:
        """What to write of a calibration."""

    @abstractmethod
    def summary(self) -> Answer:
        """Where the subject stands, once all is written."""

    @abstractmethod
    def forget_views(self) -> str:
        """Forget what there is to calibrate from; what is said of it. Raises CalibrationError, and forgets nothing."""

    def write_views(self, again: bool) -> None:
        """Write the views that are not on disk yet; ``again``: also those that are. Raises CalibrationError."""

    def objection(self, outcome: Result, before: Result) -> str:
        """Why a calibration that nobody asked for does not take the place of the one before; empty where it does."""
        return ""

    @property
    def standing(self) -> Standing[Result]:
        """What is in force."""
        return self._standing

    @property
    def outcome(self) -> Result | None:
        """The calibration in force."""
        return self._standing.outcome

    @property
    def unwritten(self) -> bool:
        """Whether there is something that the disk does not hold; looks at the disk."""
        return any(not file.held for file in self._standing.files)

    @property
    def gone(self) -> tuple[Path, ...]:
        """Files that were written and are there no longer; looks at the disk."""
        return tuple(file.path for file in self._standing.files if file.gone)

    def calibrate_if_due(self) -> None:
        """Automatic calibration: whenever there is something new, once the one before has ended."""
        if not self._workplace.tuning().auto_calibrate:
            return
        basis = self.basis()
        if not self.enough(basis):
            return
        with self._lock:
            waiting = any(attempt.basis is None for attempt in self._under_way)
            if self._busy or waiting or basis == self._attempted:
                return
            self._busy = True
            attempt = _Attempt(False, basis.generation, automatic=True)
            self._under_way.append(attempt)
        self._queue(attempt)

    def calibrate(self) -> Promise:
        """Calibrate from all that there is; the promise's answer comes with the result.

        Where one from the same waits or runs already, its promise is shared.
        """
        basis = self.basis()
        with self._lock:
            for attempt in self._under_way:
                if attempt.generation == basis.generation and attempt.basis in (None, basis):
                    attempt.asked = True
                    return attempt.promise
            attempt = _Attempt(True, basis.generation)
            self._under_way.append(attempt)
        return self._queue(attempt)

    def save(self, stopping: threading.Event) -> Answer:
        """Write everything again; waits for the disk."""
        return self._written(again=True)

    def retry_writing(self) -> None:
        """Write what the disk does not hold; waits for the disk."""
        self._write(again=False)

    def reset(self) -> Answer:
        """Forget views and calibrations."""
        with self._telling:
            try:
                with self._writing:
                    forgotten = self.forget_views()
                    with self._lock:
                        self._standing = self._initial
            except CalibrationError as error:
                return Answer(False, f"{self.name}: {error}")
            self._tell(self._initial.outcome)
        for key in ("size", "calibration"):
            self._workplace.announcer.over(f"{self.name} {key}")
        return Answer(True, f"{self.name}: {forgotten}")

    def attempted(self, basis: Basis) -> bool:
        """Whether this is what the last calibration rested on, whatever became of it."""
        with self._lock:
            return basis == self._attempted

    def not_written(self, error: CalibrationError) -> None:
        """Tell that the disk refused something."""
        text = f"{self.name}: {error}; all stays in memory and writing is tried again"
        self._workplace.announcer.warn_once(f"{self.name} disk", text)

    def _queue(self, attempt: _Attempt) -> Promise:
        task = Task(
            self.calibrator, lambda: self._begin(attempt), lambda outcome, error: self._end(attempt, outcome, error)
        )
        self._workplace.pool.queue_job(task)
        return attempt.promise

    def _begin(self, attempt: _Attempt) -> tuple[Any, ...]:
        basis = self.basis()
        if basis.generation != attempt.generation:
            raise CalibrationError(_RESET)
        with self._lock:
            self._begun += 1
            attempt.number, attempt.basis = self._begun, basis
            self._attempted = basis
        return self.arguments(basis)

    def _end(self, attempt: _Attempt, outcome: Result | None, error: CalibrationError | None) -> None:
        try:
            attempt.promise.answer = self._concluded(attempt, outcome, error)
        finally:
            with self._lock:
                self._under_way.remove(attempt)
                self._busy &= not attempt.automatic
            attempt.promise.ready.set()
        self._workplace.ended()

    def _concluded(self, attempt: _Attempt, outcome: Result | None, error: CalibrationError | None) -> Answer:
        announcer = self._workplace.announcer
        with self._telling:
            if attempt.generation != self.basis().generation:
                return Answer(False, f"{self.name}: {_RESET}")
            if outcome is None:
                if not attempt.asked:
                    announcer.warn_once(f"{self.name} calibration", f"{self.name}: not calibrated: {error}")
                return Answer(False, f"{self.name}: {error}")
            announcer.over(f"{self.name} calibration")
            kept = self._why_the_one_before_stays(attempt, outcome)
            if kept:
                return Answer(True, f"{self.name}: {kept}; it stays")
            files = tuple(KeptFile(path) for path in self.files(outcome))
            with self._lock:
                self._standing = Standing(outcome, attempt.number, files)
            self._tell(outcome)
        answer = self._written()
        announcer.info(answer.text)
        return answer

    def _why_the_one_before_stays(self, attempt: _Attempt, outcome: Result) -> str:
        before = self._standing
        if attempt.number < before.number:  # several workers: the later one was faster
            return "a calibration that began later is in force already"
        return "" if before.outcome is None or attempt.asked else self.objection(outcome, before.outcome)

    def _written(self, again: bool = False) -> Answer:
        if not self._write(again):
            return Answer(False, f"{self.name}: not written; all stays in memory and writing is tried again")
        return self.summary()

    def _write(self, again: bool) -> bool:
        gone = self.gone
        try:
            self.write_views(again)
            self._write_files(again)
        except CalibrationError as error:
            self.not_written(error)
            return False
        if self.unwritten:  # more has come meanwhile
            return True
        self._workplace.announcer.over(f"{self.name} disk", f"{self.name}: everything is written now")
        if gone:
            lost = ", ".join(map(str, gone))
            self._workplace.announcer.info(f"{self.name}: {lost} had gone from the disk, or was changed: written again")
        return True

    def _write_files(self, again: bool) -> None:
        with self._writing:
            standing = self._standing
            texts = self.files(standing.outcome) if standing.files and standing.outcome is not None else {}
            for file in standing.files:
                if again or not file.held:
                    file.write(texts[file.path].encode())
