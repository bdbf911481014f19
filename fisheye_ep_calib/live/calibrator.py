"""The live calibrator without ROS: frames in, views kept, cameras calibrated, files written."""

from __future__ import annotations

import threading
from typing import Any, Protocol

import numpy as np

from fisheye_ep_calib.errors import CalibrationError
from fisheye_ep_calib.live.announcer import Announcer
from fisheye_ep_calib.live.answer import Answer, together
from fisheye_ep_calib.live.camera import LiveCamera
from fisheye_ep_calib.live.camera_views import CameraViews, Verdict
from fisheye_ep_calib.live.check import Check
from fisheye_ep_calib.live.frame import RawFrame, Sighting, detect_in_frame
from fisheye_ep_calib.live.kept_images import KeptImages
from fisheye_ep_calib.live.outcome import Outcome
from fisheye_ep_calib.live.overlay import OverlayRequest, Pictures
from fisheye_ep_calib.live.rig import LiveRig
from fisheye_ep_calib.live.rig_outcome import RigOutcome
from fisheye_ep_calib.live.rig_views import stamp_of
from fisheye_ep_calib.live.settings import CameraSettings, Settings, Tuning
from fisheye_ep_calib.live.status import Reception, Status, camera_status, headline, rig_status, say
from fisheye_ep_calib.live.subject import Subject, Workplace
from fisheye_ep_calib.live.work_pool import Task, WorkPool
from fisheye_ep_calib.storage.folder_owner import FolderOwner


class Listener(Protocol):
    """Who is told what happens; called on threads of the pool."""

    def calibrated(self, camera: str, outcome: Outcome | None) -> None:
        """A calibration comes into force; None: there is none any more."""

    def rig_calibrated(self, outcome: RigOutcome | None) -> None:
        """A calibration of the rig comes into force; None: there is none any more."""

    def wanted_pictures(self, camera: str) -> frozenset[str]:
        """Which of the camera's pictures (``Pictures``) anybody looks at."""

    def pictures(self, camera: str, header: Any, pictures: Pictures) -> None:
        """Of the image that had this header."""


class LiveCalibrator:
    """Any number of cameras behind one pool of workers. Methods return at once unless they say otherwise."""

    def __init__(self, settings: Settings, tuning: Tuning, announcer: Announcer, listener: Listener) -> None:
        """Raises InputError where an earlier run's views cannot be taken up, CalibrationError where another program
        writes into the same folder.
        """
        self.folder = settings.output_directory
        self._announcer = announcer
        self._listener = listener
        self._tuning = tuning
        self._published = {camera.name: camera.initial for camera in settings.cameras}
        self._stopping = threading.Event()
        self._images = KeptImages(settings.output_directory, settings.keep_images, announcer)
        self._owner: FolderOwner | None = None
        self._checking = settings.check
        if not settings.check and any(camera.target is not None for camera in settings.cameras):
            self._owner = FolderOwner(settings.output_directory, "the live calibrator")
            self._owner.hold()
        try:
            views = _views_of(settings, tuning, announcer, self._images)
        except BaseException:
            self._release()
            raise
        together_ns = None if settings.rig is None else round(settings.rig.tolerance * 1e9)
        self.pool = WorkPool(settings.workers, self._task_failed, together_ns)
        self.rig: LiveRig | None = None
        workplace = Workplace(self.pool, announcer, lambda: self._tuning, self._calibrate_if_due)
        # A camera without a target is published and nothing else.
        self.cameras = {
            camera.name: self._camera(camera, views[camera.name], workplace)
            for camera in settings.cameras
            if camera.name in views
        }
        if settings.rig is not None:
            topics = {camera.name: camera.topic for camera in settings.cameras}
            self.rig = LiveRig(
                tuple(self.cameras.values()),
                topics,
                settings.rig,
                settings.output_directory,
                workplace,
                listener.rig_calibrated,
            )
        self._calibrate_if_due()

    def tune(self, tuning: Tuning) -> None:
        """Change what may change while running."""
        self._tuning = tuning
        for camera in self.cameras.values():
            camera.views.limits = tuning.limits

    def offer(self, name: str, message: Any, frame_name: str) -> None:
        """Take a camera's newest image message; one that nobody looked at yet is dropped for it."""
        camera = self.cameras.get(name)
        if camera is None:
            return
        wanted = self._checking or not camera.views.full or (self.rig is not None and self.rig.views.wants(name))
        if not wanted and not self._listener.wanted_pictures(name):
            camera.views.count(received=1)
            return
        header, generation = message.header, camera.views.generation
        frame = RawFrame.from_message(message, frame_name)

        def arguments() -> tuple[Any, ...]:
            outcome = camera.outcome
            lens = None if outcome is None else outcome.camera
            return frame, camera.views.target, lens, self._overlay(camera), camera.other_board.due()

        def done(sighting: Sighting | None, error: CalibrationError | None) -> None:
            self._images.offer(name, frame)
            self._searched(camera, sighting, error, generation)
            if sighting is not None and sighting.pictures is not None:
                self._listener.pictures(name, header, sighting.pictures)

        dropped = self.pool.offer_frame(name, Task(detect_in_frame, arguments, done, stamp_of(frame_name)))
        camera.views.count(received=1, dropped=int(dropped))

    def outcome(self, name: str) -> Outcome | None:
        """The calibration in force of a camera, be it one that is only published."""
        return self.cameras[name].outcome if name in self.cameras else self._published[name]

    def calibrate(self) -> Answer:
        """Calibrate every camera from all its views, then the rig, and wait for the results."""
        waiting = [camera.calibrate() for camera in self.cameras.values()]
        answers = [promise.wait(self._stopping) for promise in waiting]
        if self.rig is not None:
            answers.append(self.rig.calibrate().wait(self._stopping))
        return together(answers)

    def save(self) -> Answer:
        """Write all views and calibrations again; waits for the disk."""
        return together([subject.save(self._stopping) for subject in self._subjects()])

    def report(self, name: str | None = None) -> Answer:
        """Write a camera's report, or all cameras', and wait for it."""
        waiting = [camera.report() for camera in self.cameras.values() if name in (None, camera.name)]
        return together([promise.wait(self._stopping) for promise in waiting])

    def reset(self, name: str | None = None) -> Answer:
        """Forget a camera's views and calibrations, or all cameras'; their observation files are set aside.

        The rig's calibration is forgotten with any of them.
        """
        answers = []
        for camera in self.cameras.values():
            if name in (None, camera.name):
                answers.append(camera.reset())
                if answers[-1].success:
                    self._images.set_aside(camera.name)
        if self.rig is not None:
            self.rig.reset()
        return together(answers)

    def retry_writing(self) -> None:
        """Write what the disk does not hold; call it now and then."""
        try:
            self._hold_folder()
        except CalibrationError as error:  # the folder was removed, and another program has it since
            self._announcer.warn_once("pool folder", str(error))
            return
        for subject in self._subjects():
            subject.retry_writing()
        self._images.write()

    def stop(self) -> None:
        """End the workers, whatever they are doing, and write what is not written yet."""
        self._stopping.set()
        self.pool.stop()
        self.retry_writing()
        for subject in self._subjects():
            if subject.unwritten:
                self._announcer.warning(f"{subject.name}: ended with what the disk has not taken; that is lost")
        self._release()

    def rig_status(self) -> Status | None:
        """Where the rig stands; None where the cameras are none."""
        return None if self.rig is None else rig_status(self.rig, self._standing_warnings(self.rig.name))

    def status(self, reception: dict[str, Reception]) -> list[Status]:
        """Where each camera stands, given how its images arrive."""
        return [
            camera_status(camera, reception[name], self._standing_warnings(name, "pool"), self._tuning)
            for name, camera in self.cameras.items()
        ]

    def _hold_folder(self) -> None:
        if self._owner is not None:
            self._owner.hold()
            self._announcer.over("pool folder")

    def _release(self) -> None:
        if self._owner is not None:
            self._owner.release()

    def _standing_warnings(self, *about: str) -> list[str]:
        return [text for key, text in self._announcer.standing().items() if key.partition(" ")[0] in about]

    def _camera(self, settings: CameraSettings, views: CameraViews, workplace: Workplace) -> LiveCamera:
        def tell(outcome: Outcome | None) -> None:
            if outcome is not None and outcome.advice is not None:
                self.cameras[settings.name].follow(outcome.advice.plan)
            self._listener.calibrated(settings.name, outcome)

        check = None
        if self._checking and settings.initial is not None:
            check = Check(settings.name, views.target, settings.initial, self.pool, self._announcer)
        return LiveCamera(views, settings.model, workplace, tell, settings.initial, check, settings.options)

    def _subjects(self) -> list[Subject[Any]]:
        return [*self.cameras.values(), *([] if self.rig is None else [self.rig])]

    def _calibrate_if_due(self) -> None:
        for subject in self._subjects():
            subject.calibrate_if_due()

    def _overlay(self, camera: LiveCamera) -> OverlayRequest | None:
        looked_at = self._listener.wanted_pictures(camera.name)
        if not looked_at:
            return None
        nothing = np.empty((0, 2))
        wanted = None if camera.views.full else camera.guide.wanted
        lines = [headline(camera), say(camera, self._tuning)]
        if self.rig is not None:
            lines.append(f"rig: {self.rig.next_step}")
        covered = np.concatenate([nothing, *(view.pixels for view in camera.views.kept)])
        return OverlayRequest(
            covered,
            nothing if wanted is None else wanted.outline,
            tuple(lines),
            refused=self._tuning.show_refused,
            signature=None if wanted is None else wanted.signature,
            **{which: which in looked_at for which in ("raw", "compressed", "page")},
        )

    def _task_failed(self, text: str) -> None:
        self._announcer.warn_once("pool", f"this should not happen: {text}")

    def _searched(
        self, camera: LiveCamera, sighting: Sighting | None, error: CalibrationError | None, generation: int
    ) -> None:
        """generation: of the camera's views, when the frame came; what was seen before a reset is forgotten too."""
        name, views = camera.name, camera.views
        if sighting is None:
            views.count(unreadable=1)
            self._announcer.mention(f"{name} unreadable", f"{name}: a frame is skipped: {error}")
            return
        try:
            if camera.check is None:
                verdict = views.consider(sighting, generation)
            else:
                views.count(searched=1, detected=int(len(sighting.detection) > 0))
                verdict = camera.check.take(sighting)
        except CalibrationError as failure:
            camera.not_written(failure)
            verdict = Verdict.KEPT
        camera.searched(sighting, verdict)
        if verdict is Verdict.OTHER_SIZE:
            self._tell_other_size(views, sighting)
        if verdict is Verdict.KEPT:
            self._tell_kept(camera, sighting.name, f"kept, {len(sighting.detection)} points")
        if self.rig is not None and verdict in (Verdict.KEPT, Verdict.NOT_NEW, Verdict.FULL):
            self._keep_for_rig(self.rig, name, sighting, generation, verdict)
        self._calibrate_if_due()

    def _keep_for_rig(self, rig: LiveRig, name: str, sighting: Sighting, generation: int, verdict: Verdict) -> None:
        for partner in rig.views.partners(name, sighting, generation, kept=verdict is Verdict.KEPT):
            camera = self.cameras[partner.camera]
            try:
                fits = camera.views.keep(partner.view, partner.image_size, partner.generation)
            except CalibrationError as failure:
                camera.not_written(failure)
                fits = True
            if fits:
                self._tell_kept(camera, partner.view.name, f"kept for the rig, {len(partner.view.pixels)} points")

    def _tell_kept(self, camera: LiveCamera, frame_name: str, how: str) -> None:
        number = camera.views.number_of(frame_name)  # by name: another worker may have added one since
        if not number:
            return
        where = ", in memory only" if camera.views.unwritten else ""
        self._announcer.info(f"{camera.name}: view {number} {how}{where}")
        self._images.keep(camera.name, frame_name)

    def _tell_other_size(self, views: CameraViews, sighting: Sighting) -> None:
        now, before = sighting.image_size, views.image_size
        if before is None:  # reset meanwhile
            return
        self._announcer.warn_once(
            f"{views.name} size",
            f"{views.name}: images are {now[0]}×{now[1]} now, the kept views {before[0]}×{before[1]}: "
            "they are skipped; call ~/reset to start anew with this size",
        )


def _views_of(settings: Settings, tuning: Tuning, announcer: Announcer, images: KeptImages) -> dict[str, CameraViews]:
    """Of every camera with a target, those of an earlier run among them. Raises InputError."""
    of_cameras = {}
    for camera in settings.cameras:
        if camera.target is None:
            continue
        file = settings.output_directory / f"{camera.name}.npz"
        views = CameraViews(camera.name, camera.target, file, tuning.limits)
        resumed = 0 if settings.check else views.start(settings.resume)
        if not (settings.resume or settings.check):
            images.set_aside(camera.name)
        if resumed:
            announcer.info(f"{camera.name}: going on with {resumed} views from {file}")
        of_cameras[camera.name] = views
    return of_cameras
