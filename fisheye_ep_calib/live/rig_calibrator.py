"""Calibrates the rig while its cameras are being calibrated: in the worker pool, whenever there is something new."""

from __future__ import annotations

import threading
from collections.abc import Callable
from typing import Any

from fisheye_ep_calib.errors import CalibrationError
from fisheye_ep_calib.live.announcer import Announcer
from fisheye_ep_calib.live.answer import Answer, Promise
from fisheye_ep_calib.live.rig_outcome import RigOutcome, calibrate_members
from fisheye_ep_calib.live.rig_session import Basis, RigSession
from fisheye_ep_calib.live.rig_status import next_step, rig_status
from fisheye_ep_calib.live.status import Status
from fisheye_ep_calib.live.work_pool import Task, WorkPool

KEY = "rig"  # of what is announced


class RigCalibrator:
    """Methods return at once unless they say otherwise."""

    def __init__(
        self,
        session: RigSession,
        pool: WorkPool,
        announcer: Announcer,
        automatic: Callable[[], bool],
        on_calibrated: Callable[[RigOutcome | None], None],
    ) -> None:
        """automatic: whether to calibrate without being asked.

        on_calibrated: told of each calibration that comes into force; None: there is none any more.
        """
        self.session = session
        self._pool = pool
        self._announcer = announcer
        self._automatic = automatic
        self._on_calibrated = on_calibrated
        self._lock = threading.Lock()
        self._adopting = threading.RLock()
        self._attempted: Basis | None = None  # of the last calibration, whatever became of it
        self._busy = False

    def calibrate_if_due(self) -> None:
        """Automatic calibration: once every camera has one of its own, whenever there is something new."""
        session = self.session
        if not self._automatic() or session.uncalibrated:
            return
        basis = session.basis()
        with self._lock:
            if self._busy or len(basis.joined) < 2 or basis == self._attempted:
                return
            self._busy = True
        self._queue(asked=False)

    def calibrate(self, stopping: threading.Event) -> Answer:
        """Calibrate from all common views and wait for the result."""
        return self._queue(asked=True).wait(stopping)

    def save(self, stopping: threading.Event) -> Answer:
        """Calibrate where something is new, and write the files again; waits for both."""
        basis, outcome = self.session.basis(), self.session.outcome
        if self.session.uncalibrated or len(basis.joined) < 2:
            return Answer(True, f"rig: not calibrated yet; {self.next_step}")
        if outcome is None or basis != self._attempted:
            return self.calibrate(stopping)
        return self._saved(outcome, again=True)

    def reset(self) -> None:
        """The cameras' views are gone."""
        with self._adopting:
            self.session.forget()
            self._on_calibrated(None)
        with self._lock:
            self._attempted = None
        self._announcer.over(f"{KEY} calibration")

    def retry_writing(self) -> None:
        """Write what the disk refused before."""
        self._write()

    @property
    def next_step(self) -> str:
        """What would help most, in one sentence."""
        return next_step(self.session)

    def status(self) -> Status:
        standing = self._announcer.standing()
        return rig_status(self.session, [text for key, text in standing.items() if key.partition(" ")[0] == KEY])

    def _queue(self, asked: bool) -> Promise:
        promise, session = Promise(), self.session
        generations = session.generations()

        def arguments() -> tuple[Any, ...]:
            basis = session.basis()
            if basis.generations != generations:
                raise CalibrationError("its views were reset meanwhile")
            with self._lock:
                self._attempted = basis
            members = session.members(basis.joined)
            if len(members) < 2:
                raise CalibrationError(self.next_step)
            return members, session.views.tolerance, session.unmistakable

        def done(outcome: RigOutcome | None, error: CalibrationError | None) -> None:
            try:
                promise.answer = self._calibrated(outcome, error, generations, asked)
            finally:
                promise.ready.set()
                if not asked:
                    with self._lock:
                        self._busy = False
            self.calibrate_if_due()

        self._pool.queue_job(Task(calibrate_members, arguments, done))
        return promise

    def _calibrated(
        self, outcome: RigOutcome | None, error: CalibrationError | None, generations: tuple[int, ...], asked: bool
    ) -> Answer:
        if generations != self.session.generations():
            return Answer(False, "rig: its views were reset meanwhile")
        if outcome is None:
            if not asked:
                self._announcer.warn_once(f"{KEY} calibration", f"rig: not calibrated: {error}")
            return Answer(False, f"rig: {error}")
        with self._adopting:
            if not self.session.adopt(outcome, generations):
                return Answer(False, "rig: its views were reset meanwhile")
            self._on_calibrated(outcome)
        self._announcer.over(f"{KEY} calibration")
        answer = self._saved(outcome)
        self._announcer.info(answer.text)
        return answer

    def _saved(self, outcome: RigOutcome, again: bool = False) -> Answer:
        if not self._write(again):
            return Answer(False, "rig: not written; it stays in memory and writing is tried again")
        apart = [name for name in self.session.names if name not in outcome.figures["cameras"]]
        missing = f"; not joined: {', '.join(apart)}; {self.next_step}" if apart else ""
        return Answer(not apart, f"rig: {outcome.summary}, in {self.session.rig_file}{missing}")

    def _write(self, again: bool = False) -> bool:
        try:
            self.session.write(again)
        except CalibrationError as error:
            text = f"rig: {error}; it stays in memory and writing is tried again"
            self._announcer.warn_once(f"{KEY} disk", text)
            return False
        self._announcer.over(f"{KEY} disk", "rig: everything is written now")
        return True
