"""Looking at images in worker processes, each of which reads, decodes and detects by itself.

Only an image's number goes to a worker and only what was found comes back: memory holds one image a worker.
"""

from __future__ import annotations

import contextlib
import os
import pickle
import struct
from collections import deque
from collections.abc import Iterable
from concurrent.futures import FIRST_COMPLETED, Future, ProcessPoolExecutor, wait
from concurrent.futures.process import BrokenProcessPool
from pathlib import Path
from typing import Any

import cv2

from fisheye_ep_calib.collection.look import ENDLESS, Job, failed_on, limits, look
from fisheye_ep_calib.collection.look_in_time import LookInTime
from fisheye_ep_calib.collection.results import FrameResult
from fisheye_ep_calib.errors import InputError
from fisheye_ep_calib.storage.recording import Recording
from fisheye_ep_calib.storage.scratch import Scratch
from fisheye_ep_calib.target.base import Target
from fisheye_ep_calib.target.detection import Detector
from fisheye_ep_calib.worker_processes import (
    KnownProcesses,
    deaf_to_interrupts,
    end_after,
    inherited_by_workers,
    prepare_worker,
)

_SEARCH, _NOTES, _NOTE = "search", "notes", struct.Struct("<qq")  # a note: process, number of the image
QUEUED_A_WORKER = 6  # images, so that workers go on while the next round is planned


class FrameWorkers:
    """Worker processes for one recording and one target; 0 of them looks in the calling process."""

    def __init__(self, recording: Recording, target: Target, workers: int) -> None:
        """Raises InputError where this machine lacks what looking for the target needs."""
        if workers < 0:
            raise InputError(f"the number of workers must not be negative, but is {workers}")
        self._recording = recording
        self._target = target
        target.detector()
        self._here: LookInTime | None = None
        self._workers = workers
        self._pool: ProcessPoolExecutor | None = None
        self._processes = KnownProcesses()
        self._needs_main = False
        self._scratch: Scratch | None = None
        self._numbers: list[Job] = []  # of the images, as the workers note them
        self._waiting: deque[Job] = deque()
        self._running: dict[Future[Any], Job] = {}
        self._ready: deque[FrameResult] = deque()

    def add(self, jobs: Iterable[Job]) -> None:
        """Have these images looked at; more may be added while others are waited for."""
        self._waiting.extend(jobs)
        if self._pool is not None:
            self._fill()

    def next_result(self) -> FrameResult | None:
        """What one of the images shows, in no particular order; None once all have been looked at."""
        if self._workers == 0:
            return self._look_here(self._waiting.popleft()) if self._waiting else None
        while not self._ready and (self._waiting or self._running):
            self._fill()
            self._gather()
        return self._ready.popleft() if self._ready else None

    def close(self) -> None:
        """Forget what waits and what is in hand, and end the workers at once."""
        with deaf_to_interrupts():
            if self._running and self._pool is not None:
                self._processes.kill()
            self._waiting.clear()
            self._running.clear()
            self._ready.clear()
            self._end_pool()
            if self._here is not None:
                self._here.close()
                self._here = None
            if self._scratch is not None:
                self._scratch.close()
                self._scratch = None

    def _look_here(self, job: Job) -> FrameResult:
        threads = cv2.getNumThreads()
        cv2.setNumThreads(1)
        try:
            if self._here is None:
                self._here = LookInTime(self._recording, self._target)
            return self._here.look(job)
        finally:
            cv2.setNumThreads(threads)

    def _fill(self) -> None:
        """Keep the workers busy, with something to go on with at once."""
        with contextlib.suppress(BrokenProcessPool):  # _gather finds out what broke it
            while self._waiting and len(self._running) < QUEUED_A_WORKER * self._workers:
                self._running[self._submit(self._waiting[0])] = self._waiting[0]
                self._waiting.popleft()

    def _gather(self) -> None:
        if not self._running:  # the workers died while they had nothing to do, and take nothing any more
            self._end_pool()
            return
        try:
            for future in wait(self._running, return_when=FIRST_COMPLETED).done:
                self._ready.append(future.result())
                del self._running[future]
        except BrokenProcessPool:
            self._find_culprit()
        else:
            self._fill()

    def _find_culprit(self) -> None:
        """A worker died on an image: each that was in work gets the workers to itself, the others wait again."""
        unfinished = []
        for future, job in self._running.items():
            if future.exception() is None:
                self._ready.append(future.result())
            else:
                unfinished.append(job)
        self._running.clear()
        overdue = self._overdue()
        for job in (job for job in unfinished if job in overdue):
            self._ready.append(failed_on(self._recording, job, ENDLESS))
        if overdue:
            self._waiting.extendleft(job for job in reversed(unfinished) if job not in overdue)
            return
        in_work = self._workers + 1  # images are taken in order, and an answer may have been lost
        self._waiting.extendleft(reversed(unfinished[in_work:]))
        for job in unfinished[:in_work]:
            self._end_pool()
            try:
                self._ready.append(self._submit(job).result())
            except BrokenProcessPool:
                self._ready.append(failed_on(self._recording, job, "a worker process died on it"))
        self._end_pool()

    def _overdue(self) -> list[Job]:
        """The images that workers were looking at which were ended because they took too long."""
        self._end_pool()
        numbers = self._processes.overdue()
        if not numbers or self._scratch is None:
            return []
        with open(self._scratch.path / _NOTES, "rb") as notes:
            last = dict(_NOTE.iter_unpack(notes.read()))
        return [self._numbers[last[process]] for process in numbers if process in last]

    def _submit(self, job: Job) -> Future[Any]:
        if self._pool is None:
            self._processes = KnownProcesses()
            self._pool = ProcessPoolExecutor(
                self._workers,
                mp_context=self._processes,
                initializer=_initialize,
                initargs=(self._files(), limits()),
            )
        with inherited_by_workers(self._needs_main):  # which the pool starts when it is given work
            self._numbers.append(job)
            return self._pool.submit(_look, job, len(self._numbers) - 1)

    def _files(self) -> str:
        """A folder with recording and target, for the workers: as arguments they would keep the next one waiting for
        this one. There they note what they begin with: whoever is ended cannot tell.
        """
        if self._scratch is None:
            content = pickle.dumps((self._recording, self._target))
            self._needs_main = b"__main__" in content  # a target or a format that the caller's script defines
            self._scratch = Scratch()
            (self._scratch.path / _SEARCH).write_bytes(content)
            (self._scratch.path / _NOTES).touch()
        return str(self._scratch.path)

    def _end_pool(self) -> None:
        pool, self._pool = self._pool, None
        if pool is not None:
            pool.shutdown(wait=True, cancel_futures=True)


_process: tuple[Recording, Detector] | None = None
_note = -1  # descriptor of the file of notes
_limits = limits()


def _initialize(folder: str, seconds: tuple[float, float]) -> None:
    global _process, _note, _limits
    _limits = seconds
    prepare_worker()
    _note = os.open(Path(folder) / _NOTES, os.O_WRONLY | os.O_APPEND)
    with open(Path(folder) / _SEARCH, "rb") as file:
        recording, target = pickle.load(file)
    _process = recording, target.detector()


def _look(job: Job, number: int) -> FrameResult:
    assert _process is not None
    os.write(_note, _NOTE.pack(os.getpid(), number))
    try:
        return look(*_process, job, _limits, end_after)
    finally:
        end_after(0)
