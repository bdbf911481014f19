"""Workers serve cameras in turn, survive what goes wrong in them and end at once."""

from __future__ import annotations

import itertools
import os
import queue
import signal
import subprocess
import sys
import threading
import time
from collections.abc import Callable
from pathlib import Path

import pytest

from fisheye_ep_calib.errors import CalibrationError, InputError
from fisheye_ep_calib.live.work_pool import Task, WorkPool
from fisheye_ep_calib.live.worker_process import WorkerProcess

PATIENCE = 30.0  # seconds; only a failing test waits that long


@pytest.fixture
def pool():
    errors: list[str] = []
    pool = WorkPool(workers=1, on_error=errors.append)
    pool.errors = errors  # type: ignore[attr-defined]
    yield pool
    pool.stop()


def task(function, *arguments, outcomes: queue.Queue) -> Task:
    return Task(function, lambda: arguments, lambda result, error: outcomes.put((result, error)))


def test_results_and_errors_come_back(pool: WorkPool) -> None:
    outcomes: queue.Queue = queue.Queue()
    pool.queue_job(task(os.path.join, "a", "b", outcomes=outcomes))
    assert outcomes.get(timeout=PATIENCE) == ("a/b", None)
    pool.queue_job(task(int, "x", outcomes=outcomes))
    result, error = outcomes.get(timeout=PATIENCE)
    assert result is None and isinstance(error, CalibrationError) and "ValueError" in str(error)


def test_the_projects_own_errors_keep_their_type() -> None:
    process = WorkerProcess()
    try:
        from fisheye_ep_calib.target.registry import load_target

        with pytest.raises(InputError):
            process.run(load_target, "/nowhere.yaml")
    finally:
        process.close()


def test_a_dead_worker_is_named_and_replaced(pool: WorkPool) -> None:
    outcomes: queue.Queue = queue.Queue()
    pool.queue_job(task(os._exit, 7, outcomes=outcomes))
    assert "7" in str(outcomes.get(timeout=PATIENCE)[1])
    pool.queue_job(task(os.path.join, "a", "b", outcomes=outcomes))
    assert outcomes.get(timeout=PATIENCE) == ("a/b", None)


def test_a_frame_that_takes_without_end_costs_only_itself(pool: WorkPool, monkeypatch) -> None:
    monkeypatch.setattr("fisheye_ep_calib.live.work_pool._FRAME_SECONDS", 0.5)
    outcomes: queue.Queue = queue.Queue()
    pool.offer_frame("a", task(sum, itertools.repeat(1), outcomes=outcomes))
    assert "0 s of processor time" in str(outcomes.get(timeout=PATIENCE)[1])
    pool.offer_frame("a", task(os.path.join, "a", "b", outcomes=outcomes))
    assert outcomes.get(timeout=PATIENCE) == ("a/b", None)


def test_a_failing_callback_does_not_end_the_pool(pool: WorkPool) -> None:
    outcomes: queue.Queue = queue.Queue()
    pool.queue_job(Task(os.getpid, tuple, lambda result, error: 1 / 0))
    pool.queue_job(task(os.getpid, outcomes=outcomes))
    outcomes.get(timeout=PATIENCE)
    assert "ZeroDivisionError" in pool.errors[0]  # type: ignore[attr-defined]


def test_only_the_newest_frame_waits_and_cameras_take_turns(pool: WorkPool) -> None:
    outcomes: queue.Queue = queue.Queue()
    started = threading.Event()
    pool.queue_job(Task(time.sleep, lambda: (started.set(), 0.5)[1:], lambda result, error: None))
    assert started.wait(PATIENCE)
    dropped = [pool.offer_frame("flood", task(str, number, outcomes=outcomes)) for number in range(100)]
    assert not pool.offer_frame("rare", task(str, "rare", outcomes=outcomes))
    dropped += [pool.offer_frame("flood", task(str, number, outcomes=outcomes)) for number in range(100, 200)]
    assert dropped.count(True) == 199
    assert [outcomes.get(timeout=PATIENCE)[0] for _ in range(2)] == ["199", "rare"]


@pytest.mark.parametrize("together_ns", [1000, None])
def test_a_frame_that_goes_with_one_taken_is_not_replaced(together_ns) -> None:
    """Two cameras, whose frames come in tenths of a second, and one worker that is slower."""
    pool = WorkPool(1, print, together_ns)
    outcomes: queue.Queue = queue.Queue()
    started, go_on = threading.Event(), threading.Event()

    def offer(camera: str, stamp: int, arguments: Callable[[], tuple] = tuple) -> bool:
        done = lambda result, error: outcomes.put((camera, stamp))  # noqa: E731
        return pool.offer_frame(camera, Task(os.getpid, arguments, done, 1000 * stamp))

    try:
        offer("a", 105, lambda: (started.set(), go_on.wait(PATIENCE))[2:])
        assert started.wait(PATIENCE)
        for tenth in range(1, 10):
            dropped = [offer("b", 100 * tenth + 5)]
            if tenth > 1:
                dropped.append(offer("a", 100 * tenth))
            assert all(dropped) == (tenth > 2)
        go_on.set()
        assert outcomes.get(timeout=PATIENCE) == ("a", 105)
        found = [outcomes.get(timeout=PATIENCE) for _ in range(2)]
        assert found == ([("b", 105), ("a", 900)] if together_ns else [("b", 905), ("a", 900)])
        if together_ns:
            assert offer("b", 905) is False
            assert outcomes.get(timeout=PATIENCE) == ("b", 905)
    finally:
        pool.stop()


def test_frames_go_on_beside_a_calibration() -> None:
    pool = WorkPool(workers=2, on_error=print)
    try:
        outcomes: queue.Queue = queue.Queue()
        for _ in range(2):
            pool.queue_job(Task(time.sleep, lambda: (60,), lambda result, error: None))
        pool.offer_frame("front", task(str, "frame", outcomes=outcomes))
        assert outcomes.get(timeout=PATIENCE)[0] == "frame"
    finally:
        began = time.monotonic()
        pool.stop()
        assert time.monotonic() - began < 2.0


def test_workers_end_with_a_killed_parent() -> None:
    code = (
        "import os, sys, time; from fisheye_ep_calib.live.worker_process import WorkerProcess\n"
        "if __name__ == '__main__':\n"
        "    print(WorkerProcess().run(os.getpid), flush=True); time.sleep(60)\n"
    )
    script = [sys.executable, "-c", code]
    parent = subprocess.Popen(script, stdout=subprocess.PIPE, text=True)
    worker = int(parent.stdout.readline())
    parent.send_signal(signal.SIGKILL)
    parent.wait()
    parent.stdout.close()
    give_up = time.monotonic() + PATIENCE
    while Path(f"/proc/{worker}").exists() and time.monotonic() < give_up:
        time.sleep(0.05)
    assert not Path(f"/proc/{worker}").exists()
