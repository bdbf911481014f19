"""Looking in a thread of its own, which is given up where it takes without end: for who cannot end a process for it."""

from __future__ import annotations

import ctypes
import pickle
import queue
import threading
import time
from typing import Any

from fisheye_ep_calib.collection.look import ENDLESS, Job, failed_on, limits, look
from fisheye_ep_calib.collection.results import FrameResult
from fisheye_ep_calib.storage.recording import Recording
from fisheye_ep_calib.target.base import Target
from fisheye_ep_calib.target.detection import Detector

_TICK = 0.5  # seconds between two looks at the clock


class LookInTime:
    """A thread that looks at images of one recording, one at a time; replaced by another one where it is given up.

    given_up: how many were. Each goes on as long as it is in C, with files of its own, until the process ends.
    """

    def __init__(self, recording: Recording, target: Target) -> None:
        self._recording, self._target = recording, target
        self._thread: _Thread | None = None
        self.given_up = 0

    def look(self, job: Job) -> FrameResult:
        """As ``look``, within the same seconds of processor time as in a worker process."""
        if self._thread is None:
            self._thread = _Thread(self._recording, self._target.detector())
        done = self._thread.result_of(job)
        if done is not None:
            return done
        self._thread.give_up()
        self._thread, self.given_up = None, self.given_up + 1
        self._recording = pickle.loads(pickle.dumps(self._recording))  # the lost thread keeps its open files to itself
        return failed_on(self._recording, job, ENDLESS)

    def close(self) -> None:
        """Let the thread end, for which it has a moment: files that it reads from may be closed next."""
        if self._thread is not None:
            self._thread.jobs.put(None)
            self._thread.join(timeout=1.0)
            self._thread = None


class _Thread(threading.Thread):
    def __init__(self, recording: Recording, detector: Detector) -> None:
        super().__init__(daemon=True)
        self._search = recording, detector
        self.jobs: queue.SimpleQueue[Job | None] = queue.SimpleQueue()
        self._results: queue.SimpleQueue[FrameResult | BaseException] = queue.SimpleQueue()
        self._until = 0.0  # of this thread's own clock
        self.start()

    def result_of(self, job: Job) -> FrameResult | None:
        """What the image shows; None where that takes too long."""
        self._until = float("inf")
        self.jobs.put(job)
        while True:
            try:
                result: Any = self._results.get(timeout=_TICK)
            except queue.Empty:
                if _processor_seconds(self) > self._until:
                    return None
                continue
            if isinstance(result, BaseException):
                raise result
            return result  # type: ignore[no-any-return]  # what is no exception

    def give_up(self) -> None:
        """Ends it as soon as it is in Python again."""
        self.jobs.put(None)
        ctypes.pythonapi.PyThreadState_SetAsyncExc(ctypes.c_ulong(self.ident or 0), ctypes.py_object(SystemExit))

    def run(self) -> None:
        while (job := self.jobs.get()) is not None:
            try:
                self._results.put(look(*self._search, job, limits(), self._allow))
            except BaseException as error:  # the waiting thread's to handle
                self._results.put(error)

    def _allow(self, seconds: float) -> None:
        self._until = time.thread_time() + seconds


def _processor_seconds(thread: threading.Thread) -> float:
    """Of a thread; 0 where the system does not tell."""
    if thread.ident is None or not hasattr(time, "pthread_getcpuclockid"):
        return 0.0
    return time.clock_gettime(time.pthread_getcpuclockid(thread.ident))
