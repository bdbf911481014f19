"""A child process that runs functions, so that heavy work never holds up the process that receives images."""

from __future__ import annotations

import multiprocessing
import os
import threading
from collections.abc import Callable
from multiprocessing.connection import Connection
from typing import Any

from fisheye_ep_calib.errors import CalibrationError
from fisheye_ep_calib.worker_processes import end_after, inherited_by_workers, prepare_worker, ran_too_long

_NICENESS = 10  # so far the child stands back from the programs that drive the cameras


class WorkerProcess:
    """One child process, started again at the next call after it has died."""

    def __init__(self) -> None:
        self._lock = threading.Lock()
        self._closed = False
        self._process: multiprocessing.process.BaseProcess | None = None
        self._connection: Connection | None = None

    def start(self) -> Connection:
        """Start the child unless it runs; its imports take a while, so do it early."""
        with self._lock:
            if self._closed:
                raise CalibrationError("the workers are stopped")
            if self._connection is None:
                self._process, self._connection = _start()
            return self._connection

    def run(self, function: Callable[..., Any], *arguments: Any, seconds: float = 0.0) -> Any:
        """Result of ``function(*arguments)`` in the child; its exception is raised here.

        seconds: of processor time that it may take; 0: as many as it wants. Raises CalibrationError where it takes
        more, or the child died under the work.
        """
        try:
            connection = self.start()
            connection.send((function, arguments, seconds))
            succeeded, result = connection.recv()
        except (EOFError, OSError):
            code = self._discard()
            if ran_too_long(code):
                raise CalibrationError(
                    f"it took more than {seconds:.0f} s of processor time and was given up"
                ) from None
            raise CalibrationError(f"a worker process ended unexpectedly (exit code {code})") from None
        if not succeeded:
            raise result
        return result

    def close(self) -> None:
        """End the child at once and for good, whatever it is doing; safe from any thread."""
        with self._lock:
            self._closed = True
        self._discard()

    def _discard(self) -> int | None:
        """Drop the child, dead or alive; its exit code."""
        with self._lock:
            process, self._process = self._process, None
            connection, self._connection = self._connection, None
        if process is None or connection is None:
            return None
        process.join(timeout=0.1)
        process.kill()
        process.join(timeout=1.0)
        connection.close()
        return process.exitcode


def _start() -> tuple[multiprocessing.process.BaseProcess, Connection]:
    context = multiprocessing.get_context("spawn")
    ours, theirs = context.Pipe()
    process = context.Process(target=_serve, args=(theirs,), daemon=True)
    with inherited_by_workers():
        process.start()
    theirs.close()
    return process, ours


def _serve(connection: Connection) -> None:
    """The child's life: run what arrives until the parent is gone."""
    prepare_worker()
    os.nice(_NICENESS)
    while True:
        try:
            function, arguments, seconds = connection.recv()
        except (EOFError, OSError):
            return
        end_after(seconds)
        try:
            reply = (True, function(*arguments))
        except CalibrationError as error:
            reply = (False, error)
        except Exception as error:  # one bad frame must not end the worker
            reply = (False, CalibrationError(f"{type(error).__name__}: {error}"))
        end_after(0)
        try:
            connection.send(reply)
        except (BrokenPipeError, ConnectionResetError):
            return
