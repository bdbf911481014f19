"""Shares a few worker processes between cameras: each one's newest frame in turn, calibrations beside."""

from __future__ import annotations

import contextlib
import threading
from collections import OrderedDict, deque
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

from fisheye_ep_calib.errors import CalibrationError
from fisheye_ep_calib.live.worker_process import WorkerProcess


@dataclass(frozen=True)
class Task:
    """Work for a worker process.

    function: importable by name. arguments: made when the work starts, so that they are the latest.
    done: called with (result, None) or (None, error), on a thread of the pool.
    stamp_ns: when a frame was taken, where that is known.
    """

    function: Callable[..., Any]
    arguments: Callable[[], tuple[Any, ...]]
    done: Callable[[Any, CalibrationError | None], None]
    stamp_ns: int | None = None


_FRAME_SECONDS = 10.0  # of processor time for a frame: more is a frame made to hold the worker up
_LONGEST_END = 1.0  # seconds for a thread of the pool to end


class WorkPool:
    """Worker processes behind two queues.

    Frames: at most one waits for each camera, the newest; cameras take turns, so that a flood starves none. For a rig
    a frame that goes with one already taken waits for its turn instead, so that both are looked at.
    Jobs (calibrations): first come, first served; with more than one worker, one is always left for frames.
    """

    def __init__(self, workers: int, on_error: Callable[[str], None], together_ns: int | None = None) -> None:
        """on_error: told in one line when a ``done`` failed; nothing that happens in a task ends the pool.

        together_ns: frames of several cameras whose stamps differ by this much at most go together; None: none do.
        """
        self._on_error = on_error
        self._together_ns = together_ns
        self._frames: OrderedDict[str, Task] = OrderedDict()
        self._taken: dict[str, int] = {}  # stamp of each camera's last frame that was taken
        self._jobs: deque[Task] = deque()
        self._jobs_running = 0
        self._job_limit = max(1, workers - 1)
        self._stopped = False
        self._changed = threading.Condition()
        self._processes = [WorkerProcess() for _ in range(workers)]
        self._threads = [
            threading.Thread(target=self._work, args=(process,), daemon=True, name=f"worker {number}")
            for number, process in enumerate(self._processes)
        ]
        for thread in self._threads:
            thread.start()

    def offer_frame(self, camera: str, task: Task) -> bool:
        """Queue the camera's newest frame; True where one is dropped that nobody has looked at."""
        with self._changed:
            waiting = self._frames.get(camera)
            if waiting is not None and self._goes_with_one_taken(camera, waiting):
                return True
            self._frames[camera] = task  # a replaced frame keeps its place in the turn
            self._changed.notify()
        return waiting is not None

    def queue_job(self, task: Task) -> None:
        with self._changed:
            self._jobs.append(task)
            self._changed.notify()

    def stop(self) -> None:
        """Drop what waits and end the workers, whatever they are doing."""
        with self._changed:
            self._stopped = True
            self._frames.clear()
            self._jobs.clear()
            self._changed.notify_all()
        for process in self._processes:
            process.close()
        for thread in self._threads:
            thread.join(_LONGEST_END)

    def _work(self, process: WorkerProcess) -> None:
        with contextlib.suppress(CalibrationError):
            process.start()
        while (taken := self._take()) is not None:
            task, is_job = taken
            result, error = _run(process, task, 0.0 if is_job else _FRAME_SECONDS)
            if is_job:
                self._job_ended()
            if self._stopped:
                break
            try:
                task.done(result, error)
            except Exception as failure:
                self._on_error(f"{type(failure).__name__}: {failure}")
        process.close()

    def _take(self) -> tuple[Task, bool] | None:
        """The next task and whether it is a job; None once stopped."""
        with self._changed:
            while not self._stopped:
                if self._jobs and self._jobs_running < self._job_limit:
                    self._jobs_running += 1
                    return self._jobs.popleft(), True
                if self._frames:
                    camera, frame = self._frames.popitem(last=False)
                    if frame.stamp_ns is not None:
                        self._taken[camera] = frame.stamp_ns
                    return frame, False
                self._changed.wait()
        return None

    def _goes_with_one_taken(self, camera: str, frame: Task) -> bool:
        within, stamp = self._together_ns, frame.stamp_ns
        if within is None or stamp is None:
            return False
        return any(other != camera and abs(taken - stamp) <= within for other, taken in self._taken.items())

    def _job_ended(self) -> None:
        with self._changed:
            self._jobs_running -= 1
            self._changed.notify()


def _run(process: WorkerProcess, task: Task, seconds: float) -> tuple[Any, CalibrationError | None]:
    try:
        return process.run(task.function, *task.arguments(), seconds=seconds), None
    except CalibrationError as error:
        return None, error
    except Exception as error:
        return None, CalibrationError(f"{type(error).__name__}: {error}")
