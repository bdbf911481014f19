"""Looking at images in worker processes, each of which reads, decodes and detects by itself.

Only an image's number goes to a worker and only what was found comes back: memory holds one image a worker.
"""

from __future__ import annotations

import contextlib
import multiprocessing
import os
import signal
import threading
import time
from collections.abc import Iterable, Iterator
from concurrent.futures import FIRST_COMPLETED, Future, ProcessPoolExecutor, wait
from concurrent.futures.process import BrokenProcessPool
from dataclasses import dataclass
from typing import Any

import cv2
import numpy as np

from fisheye_ep_calib.collection.results import FrameResult
from fisheye_ep_calib.errors import InputError
from fisheye_ep_calib.storage.recording import Recording
from fisheye_ep_calib.target.detection import Detection, Detector

# Workers share the cores: each keeps to one thread, which also keeps sums in one order.
ONE_THREAD = {"OMP_NUM_THREADS": "1", "OPENBLAS_NUM_THREADS": "1", "MKL_NUM_THREADS": "1"}
QUEUED_A_WORKER = 2


@dataclass(frozen=True)
class Job:
    """One image to look at; with ``camera`` and ``camera_from_target`` (4, 4), where they say to look."""

    topic: str
    index: int
    camera: Any = None
    camera_from_target: np.ndarray | None = None


class FrameWorkers:
    """Worker processes for one recording and one target; 0 of them looks in the calling process."""

    def __init__(self, recording: Recording, detector: Detector, workers: int) -> None:
        if workers < 0:
            raise InputError(f"the number of workers must not be negative, but is {workers}")
        self._recording = recording
        self._detector = detector
        self._workers = workers
        self._pool: ProcessPoolExecutor | None = None

    def run(self, jobs: Iterable[Job]) -> Iterator[FrameResult]:
        """Look at the images; results come as they are ready, in no particular order."""
        if self._workers == 0:
            threads = cv2.getNumThreads()
            cv2.setNumThreads(1)
            try:
                for job in jobs:
                    yield look(self._recording, self._detector, job)
            finally:
                cv2.setNumThreads(threads)
            return
        waiting = list(jobs)[::-1]
        running: dict[Future, Job] = {}
        while waiting or running:
            try:
                while waiting and len(running) < QUEUED_A_WORKER * self._workers:
                    running[self._submit(waiting[-1])] = waiting[-1]
                    waiting.pop()
                for future in wait(running, return_when=FIRST_COMPLETED).done:
                    result = future.result()
                    del running[future]
                    yield result
            except BrokenProcessPool:
                suspects = list(running.values())
                running.clear()
                yield from self._one_by_one(suspects)

    def _one_by_one(self, jobs: list[Job]) -> Iterator[FrameResult]:
        """Find the image that a worker died on: every suspect has the workers to itself."""
        for job in jobs:
            self.close()
            try:
                yield self._submit(job).result()
            except BrokenProcessPool:
                yield _failed(self._recording, job, "a worker process died on it")
        self.close()

    def _submit(self, job: Job) -> Future:
        if self._pool is None:
            self._pool = ProcessPoolExecutor(
                self._workers,
                mp_context=multiprocessing.get_context("spawn"),
                initializer=_initialize,
                initargs=(self._recording, self._detector),
            )
        with _inherited_by_workers():  # which the pool starts when it is given work
            return self._pool.submit(_look, job)

    def close(self) -> None:
        """End the workers once they have finished the image in hand."""
        pool, self._pool = self._pool, None
        if pool is not None:
            pool.shutdown(wait=True, cancel_futures=True)


@contextlib.contextmanager
def _inherited_by_workers() -> Iterator[None]:
    """One thread each, and no Ctrl-C: in a terminal it reaches every process, but it is the parent's to handle."""
    before = {name: os.environ.get(name) for name in ONE_THREAD}
    os.environ.update(ONE_THREAD)
    blocked = signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT})
    try:
        yield
    finally:
        signal.pthread_sigmask(signal.SIG_SETMASK, blocked)
        for name, value in before.items():
            if value is None:
                del os.environ[name]
            else:
                os.environ[name] = value


def look(recording: Recording, detector: Detector, job: Job) -> FrameResult:
    """Read, decode and search one image; a bad image is a result too."""
    frame = recording.frame(job.topic, job.index)
    started = time.perf_counter()
    try:
        image = frame.image()
    except InputError as error:
        return _failed(recording, job, str(error), time.perf_counter() - started)
    read = time.perf_counter()
    try:
        if job.camera_from_target is None:
            detection = detector.detect(image)
        else:
            detection = detector.detect_guided(image, job.camera, job.camera_from_target)
    except Exception as error:  # one strange image must not cost the others
        said = (str(error).splitlines() or [""])[0]
        return _failed(recording, job, f"the detector failed on it ({type(error).__name__}: {said})")
    size = (image.shape[1], image.shape[0])
    return FrameResult(
        job.topic,
        job.index,
        frame.stamp_ns,
        frame.name,
        size,
        detection,
        read_seconds=read - started,
        detect_seconds=time.perf_counter() - read,
    )


def _failed(recording: Recording, job: Job, error: str, seconds: float = 0.0) -> FrameResult:
    frame = recording.frame(job.topic, job.index)
    return FrameResult(job.topic, job.index, frame.stamp_ns, frame.name, None, Detection(), error, read_seconds=seconds)


_process: tuple[Recording, Detector] | None = None


def _initialize(recording: Recording, detector: Detector) -> None:
    global _process
    cv2.setNumThreads(1)
    threading.Thread(target=_end_with_parent, daemon=True).start()
    _process = (recording, detector)


def _end_with_parent() -> None:
    """A killed parent cannot say goodbye; its workers must not outlive it."""
    parent = multiprocessing.parent_process()
    if parent is not None:
        parent.join()
        os._exit(1)


def _look(job: Job) -> FrameResult:
    assert _process is not None
    return look(*_process, job)
