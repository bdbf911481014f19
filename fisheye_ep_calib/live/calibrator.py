"""The live calibrator without ROS: frames in, views kept, cameras calibrated, files written."""

from __future__ import annotations

import threading
from typing import Any, Protocol

import numpy as np

from fisheye_ep_calib.errors import CalibrationError
from fisheye_ep_calib.live.announcer import Announcer
from fisheye_ep_calib.live.answer import Answer, Promise, together
from fisheye_ep_calib.live.frame import RawFrame, Sighting, detect_in_frame
from fisheye_ep_calib.live.outcome import Outcome, calibrate_views
from fisheye_ep_calib.live.overlay import OverlayRequest
from fisheye_ep_calib.live.rig_calibrator import RigCalibrator
from fisheye_ep_calib.live.rig_outcome import RigOutcome
from fisheye_ep_calib.live.rig_session import RigSession
from fisheye_ep_calib.live.rig_views import stamp_of
from fisheye_ep_calib.live.session import CameraSession, Verdict
from fisheye_ep_calib.live.settings import Settings, Tuning
from fisheye_ep_calib.live.status import Reception, Status, camera_status, headline, next_step
from fisheye_ep_calib.live.work_pool import Task, WorkPool


class Listener(Protocol):
    """Who is told what happens; called on threads of the pool."""

    def calibrated(self, camera: str, outcome: Outcome | None) -> None:
        """A calibration comes into force; None: there is none any more."""

    def rig_calibrated(self, outcome: RigOutcome | None) -> None:
        """A calibration of the rig comes into force; None: there is none any more."""

    def wants_picture(self, camera: str) -> bool:
        """Whether anybody looks at the camera's overlay."""

    def picture(self, camera: str, header: Any, picture: np.ndarray) -> None:
        """The overlay (h, w, 3) uint8, blue green red, of the image that had this header."""


class LiveCalibrator:
    """Any number of cameras behind one pool of workers. Methods return at once unless they say otherwise."""

    def __init__(
        self,
        settings: Settings,
        tuning: Tuning,
        announcer: Announcer,
        listener: Listener,
    ) -> None:
        """Raises InputError where an earlier run's views cannot be taken up."""
        self._announcer = announcer
        self._listener = listener
        self._tuning = tuning
        self._published = {camera.name: camera.initial for camera in settings.cameras}
        self._models = {camera.name: camera.model for camera in settings.cameras}
        self._lock = threading.Lock()
        self._automatic: dict[str, int] = {}  # views that each camera's last automatic calibration had
        self._busy: set[str] = set()  # cameras whose automatic calibration is under way
        self._adopting = threading.RLock()  # held while a calibration comes into force and is told of
        self._stopping = threading.Event()
        # A camera without a target is published and nothing else.
        self.sessions = {
            camera.name: CameraSession(
                camera.name, camera.target, settings.output_directory, tuning.limits, camera.initial
            )
            for camera in settings.cameras
            if camera.target is not None
        }
        for name, session in self.sessions.items():
            resumed = session.start(settings.resume)
            if resumed:
                announcer.info(f"{name}: going on with {resumed} views from {session.observation_file}")
        together_ns = None if settings.rig is None else round(settings.rig.tolerance * 1e9)
        self._pool = WorkPool(settings.workers, self._task_failed, together_ns)
        self._rig = self._make_rig(settings)
        for name in self.sessions:
            self._calibrate_if_due(name)
        if self._rig is not None:
            self._rig.calibrate_if_due()

    def tune(self, tuning: Tuning) -> None:
        """Change what may change while running."""
        self._tuning = tuning
        for session in self.sessions.values():
            session.limits = tuning.limits

    def offer(self, name: str, message: Any, frame_name: str) -> None:
        """Take a camera's newest image message; one that nobody looked at yet is dropped for it."""
        session = self.sessions.get(name)
        if session is None:
            return
        wanted = not session.full or (self._rig is not None and self._rig.session.views.wants(name))
        if not wanted and not self._listener.wants_picture(name):
            session.count(received=1)
            return
        header, generation = message.header, session.generation

        def arguments() -> tuple:
            return RawFrame.from_message(message, frame_name), session.target, self._overlay(session)

        def done(sighting: Sighting | None, error: CalibrationError | None) -> None:
            if generation == session.generation:  # what was seen before a reset is forgotten too
                self._searched(session, sighting, error)
            if sighting is not None and sighting.picture is not None:
                self._listener.picture(name, header, sighting.picture)

        dropped = self._pool.offer_frame(name, Task(detect_in_frame, arguments, done, stamp_of(frame_name)))
        session.count(received=1, dropped=int(dropped))

    def outcome(self, name: str) -> Outcome | None:
        """The calibration in force of a camera, be it one that is only published."""
        return self.sessions[name].outcome if name in self.sessions else self._published[name]

    def calibrate(self) -> Answer:
        """Calibrate every camera from all its views, then the rig, and wait for the results."""
        waiting = [self._queue_calibration(name, asked=True) for name in self.sessions]
        answers = [promise.wait(self._stopping) for promise in waiting]
        if self._rig is not None:
            answers.append(self._rig.calibrate(self._stopping))
        return together(answers)

    def save(self) -> Answer:
        """Write every camera's views and calibration again; waits for the disk."""
        answers = [self._save(session, again=True) for session in self.sessions.values()]
        if self._rig is not None:
            answers.append(self._rig.save(self._stopping))
        return together(answers)

    def reset(self) -> Answer:
        """Forget all views and calibrations; their observation files are set aside."""
        answers = []
        for name, session in self.sessions.items():
            try:
                with self._adopting:
                    forgotten = session.reset()
                    self._listener.calibrated(name, session.outcome)
            except CalibrationError as error:
                answers.append(Answer(False, f"{name}: {error}"))
                continue
            with self._lock:
                self._automatic.pop(name, None)
            for key in ("size", "calibration"):
                self._announcer.over(f"{name} {key}")
            answers.append(Answer(True, f"{name}: {forgotten} views set aside"))
        if self._rig is not None:
            self._rig.reset()
        return together(answers)

    def retry_writing(self) -> None:
        """Write what the disk refused before; call it now and then."""
        for session in self.sessions.values():
            self._write(session)
        if self._rig is not None:
            self._rig.retry_writing()

    def stop(self) -> None:
        """End the workers, whatever they are doing, and write what is not written yet."""
        self._stopping.set()
        self._pool.stop()
        self.retry_writing()

    def rig_status(self) -> Status | None:
        """Where the rig stands; None where the cameras are none."""
        return None if self._rig is None else self._rig.status()

    def status(self, reception: dict[str, Reception]) -> list[Status]:
        """Where each camera stands, given how its images arrive."""
        standing = self._announcer.standing()
        return [
            camera_status(
                session,
                reception[name],
                [text for key, text in standing.items() if key.partition(" ")[0] in (name, "pool")],
                self._tuning,
            )
            for name, session in self.sessions.items()
        ]

    def _make_rig(self, settings: Settings) -> RigCalibrator | None:
        if settings.rig is None:
            return None
        topics = {camera.name: camera.topic for camera in settings.cameras}
        session = RigSession(tuple(self.sessions.values()), topics, settings.rig, settings.output_directory)
        return RigCalibrator(
            session, self._pool, self._announcer, lambda: self._tuning.auto_calibrate, self._listener.rig_calibrated
        )

    def _overlay(self, session: CameraSession) -> OverlayRequest | None:
        if not self._listener.wants_picture(session.name):
            return None
        views = session.views
        covered = np.concatenate([view.pixels for view in views]) if views else np.empty((0, 2))
        advice = session.outcome.advice if session.outcome else None
        wanted = advice.outline if advice else np.empty((0, 2))
        lines = [headline(session), next_step(session, self._tuning)]
        if self._rig is not None:
            lines.append(f"rig: {self._rig.next_step}")
        return OverlayRequest(covered, wanted, tuple(lines))

    def _task_failed(self, text: str) -> None:
        self._announcer.warn_once("pool", f"this should not happen: {text}")

    def _searched(self, session: CameraSession, sighting: Sighting | None, error: CalibrationError | None) -> None:
        name = session.name
        if sighting is None:
            session.count(unreadable=1)
            self._announcer.mention(f"{name} unreadable", f"{name}: a frame is skipped: {error}")
            return
        try:
            verdict = session.consider(sighting)
        except CalibrationError as failure:
            self._not_written(session, failure)
            verdict = Verdict.KEPT
        if verdict is Verdict.OTHER_SIZE:
            self._tell_other_size(session, sighting)
        if verdict is Verdict.KEPT:
            points = len(sighting.detection)
            self._announcer.info(f"{name}: view {len(session.views)} kept, {points} points")
            self._calibrate_if_due(name)
        if self._rig is not None:
            self._keep_for_rig(self._rig, name, sighting, verdict)

    def _keep_for_rig(self, rig: RigCalibrator, name: str, sighting: Sighting, verdict: Verdict) -> None:
        if verdict not in (Verdict.KEPT, Verdict.NOT_NEW, Verdict.FULL):
            return
        for partner in rig.session.views.partners(name, sighting, kept=verdict is Verdict.KEPT):
            session = self.sessions[partner.camera]
            try:
                fits = session.keep(partner.view, partner.image_size)
            except CalibrationError as failure:
                self._not_written(session, failure)
                fits = True
            if fits:
                points = len(partner.view.pixels)
                self._announcer.info(f"{session.name}: view {len(session.views)} kept for the rig, {points} points")
                self._calibrate_if_due(session.name)
        rig.calibrate_if_due()

    def _tell_other_size(self, session: CameraSession, sighting: Sighting) -> None:
        now, before = sighting.image_size, session.image_size
        assert before is not None
        self._announcer.warn_once(
            f"{session.name} size",
            f"{session.name}: images are {now[0]}×{now[1]} now, the kept views {before[0]}×{before[1]}: "
            "they are skipped; call ~/reset to start anew with this size",
        )

    def _calibrate_if_due(self, name: str) -> None:
        """Automatic calibration: whenever there are new views, once the one before has ended."""
        tuning, views = self._tuning, len(self.sessions[name].views)
        with self._lock:
            fresh = views != self._automatic.get(name, 0) and name not in self._busy
            if not (tuning.auto_calibrate and views >= tuning.minimum_views and fresh):
                return
            self._automatic[name] = views
            self._busy.add(name)
        self._queue_calibration(name, asked=False)

    def _queue_calibration(self, name: str, asked: bool) -> Promise:
        session, model = self.sessions[name], self._models[name]
        promise = Promise()
        generation = session.generation

        def arguments() -> tuple:
            if generation != session.generation:
                raise CalibrationError("its views were reset meanwhile")
            return session.observations(), model, name, str(session.observation_file)

        def done(outcome: Outcome | None, error: CalibrationError | None) -> None:
            try:
                promise.answer = self._calibrated(session, outcome, error, generation, asked)
            finally:
                promise.ready.set()
                if not asked:
                    with self._lock:
                        self._busy.discard(name)
            self._calibrate_if_due(name)
            if self._rig is not None:
                self._rig.calibrate_if_due()

        self._pool.queue_job(Task(calibrate_views, arguments, done))
        return promise

    def _calibrated(
        self,
        session: CameraSession,
        outcome: Outcome | None,
        error: CalibrationError | None,
        generation: int,
        asked: bool,
    ) -> Answer:
        name, before = session.name, session.outcome
        if generation != session.generation:
            return Answer(False, f"{name}: its views were reset meanwhile")
        if outcome is None:
            if not asked:
                self._announcer.warn_once(f"{name} calibration", f"{name}: not calibrated: {error}")
            return Answer(False, f"{name}: {error}")
        self._announcer.over(f"{name} calibration")
        if before is not None and not asked and outcome.worse_than(before):
            return Answer(True, f"{name}: the calibration from fewer views knows more; it stays")
        with self._adopting:
            if not session.adopt(outcome, generation):
                return Answer(False, f"{name}: its views were reset meanwhile")
            self._listener.calibrated(name, outcome)
        answer = self._save(session)
        self._announcer.info(answer.text)
        return answer

    def _save(self, session: CameraSession, again: bool = False) -> Answer:
        name, views, outcome = session.name, len(session.views), session.outcome
        if not self._write(session, again):
            return Answer(False, f"{name}: not written; all stays in memory and writing is tried again")
        if outcome is None or not session.calibrated:
            return Answer(True, f"{name}: {views} views in {session.observation_file}, not calibrated yet")
        numbers = "{model}, RMS {rms_px:.3f} px, {views_used} views, {points} points".format(**outcome.figures)
        return Answer(True, f"{name}: {numbers}, in {session.camera_file}")

    def _write(self, session: CameraSession, again: bool = False) -> bool:
        try:
            session.write(again)
        except CalibrationError as error:
            self._not_written(session, error)
            return False
        self._announcer.over(f"{session.name} disk", f"{session.name}: everything is written now")
        return True

    def _not_written(self, session: CameraSession, error: CalibrationError) -> None:
        text = f"{session.name}: {error}; all stays in memory and writing is tried again"
        self._announcer.warn_once(f"{session.name} disk", text)
