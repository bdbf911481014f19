"""What worker processes have in common, whoever starts them, and how many are worth starting."""

from __future__ import annotations

import contextlib
import multiprocessing
import os
import signal
import sys
import threading
from collections.abc import Iterator
from multiprocessing import resource_tracker
from multiprocessing.context import SpawnContext, SpawnProcess
from types import ModuleType
from typing import Any

_ENVIRONMENT = {
    # Workers share the cores: each keeps to one thread, which also keeps sums in one order.
    **dict.fromkeys(("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS"), "1"),
    # Bytes. glibc gives a block of an image's size back as it is freed, and the next one faults its pages in anew.
    "MALLOC_MMAP_THRESHOLD_": str(2**26),
    "MALLOC_TRIM_THRESHOLD_": str(2**27),
}

_starting = threading.Lock()


def usable_cores() -> int:
    """Cores this process may run on."""
    try:
        return len(os.sched_getaffinity(0))
    except AttributeError:
        return os.cpu_count() or 1


class KnownProcesses(SpawnContext):
    """Spawns processes and knows them: whoever is given it to start workers cannot be asked for them."""

    def __init__(self) -> None:
        super().__init__()
        self._started: list[SpawnProcess] = []

    def Process(self, *arguments: Any, **named: Any) -> SpawnProcess:  # type: ignore[override]  # called, never derived
        process = SpawnProcess(*arguments, **named)
        self._started.append(process)
        return process

    def overdue(self) -> set[int]:
        """The numbers of those that ``end_after`` has ended."""
        return {process.pid for process in self._started if process.pid and ran_too_long(process.exitcode)}

    def kill(self) -> None:
        """End all of them at once, whatever they are doing."""
        for process in self._started:
            if process.is_alive():
                process.kill()


@contextlib.contextmanager
def inherited_by_workers(needs_main: bool = False) -> Iterator[None]:
    """Processes started in here have one thread each, no Ctrl-C, and do not run the parent's script.

    In a terminal Ctrl-C reaches every process, but it is the parent's to handle. A spawned process runs the script that
    the parent was started with, so that what the script defines is there: with needs_main only, as a script without
    ``if __name__ == "__main__"`` would then start the same work again in each of them.
    """
    resource_tracker.ensure_running()  # starting with the first worker, it would unblock the signal
    with _starting:
        before = {name: os.environ.get(name) for name in _ENVIRONMENT}
        os.environ.update(_ENVIRONMENT)
        blocked = signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT})
        script = sys.modules["__main__"]
        if not needs_main:
            sys.modules["__main__"] = ModuleType("__main__")
        try:
            yield
        finally:
            sys.modules["__main__"] = script
            signal.pthread_sigmask(signal.SIG_SETMASK, blocked)
            for name, value in before.items():
                if value is None:
                    del os.environ[name]
                else:
                    os.environ[name] = value


@contextlib.contextmanager
def deaf_to_interrupts() -> Iterator[None]:
    """A second Ctrl-C must not break off what cleans up after the first. For the main thread; others hear none."""
    if threading.current_thread() is not threading.main_thread():
        yield
        return
    before = signal.signal(signal.SIGINT, signal.SIG_IGN)
    try:
        yield
    finally:
        signal.signal(signal.SIGINT, before)


def prepare_worker() -> None:
    """To be called in a worker first: OpenCV keeps to one thread too, and the process ends with its parent."""
    import cv2

    cv2.setNumThreads(1)
    threading.Thread(target=_end_with_parent, daemon=True).start()


def end_after(seconds: float) -> None:
    """Have the system end this process once it has used so much more processor time, whatever it is doing; 0: never.

    An exception would not do: what takes without end is C, which returns to no signal handler.
    """
    if hasattr(signal, "setitimer"):
        signal.setitimer(signal.ITIMER_PROF, seconds)


def ran_too_long(exit_code: int | None) -> bool:
    """Whether a process that ended so was ended by ``end_after``."""
    return hasattr(signal, "SIGPROF") and exit_code == -signal.SIGPROF


def _end_with_parent() -> None:
    """A killed parent cannot say goodbye; its workers must not outlive it, whatever they are doing."""
    parent = multiprocessing.parent_process()
    if parent is not None:
        parent.join()
        os._exit(1)
