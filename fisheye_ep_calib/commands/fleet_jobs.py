"""Each device of a fleet in a process of its own: what goes wrong in one costs no other."""

from __future__ import annotations

import argparse
import multiprocessing
import os
import signal
import sys
import time
import traceback
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from multiprocessing.connection import Connection, wait
from pathlib import Path

from fisheye_ep_calib.errors import CalibrationError
from fisheye_ep_calib.plain_text import one_line, plain_streams
from fisheye_ep_calib.storage.held import open_own
from fisheye_ep_calib.worker_processes import inherited_by_workers, prepare_worker

LAST_WORDS_SECONDS = 30  # for a device that is interrupted to keep what it found


@dataclass(frozen=True)
class DeviceJob:
    """A device and the arguments of ``calibrate`` for it. log: file for what ``calibrate`` says."""

    name: str
    arguments: argparse.Namespace
    log: Path


@dataclass(frozen=True)
class Ended:
    """How a device's calibration ended: exit code, the reason where it is not 0, seconds taken."""

    code: int
    reason: str
    seconds: float


@dataclass(frozen=True)
class _Running:
    job: DeviceJob
    process: multiprocessing.process.BaseProcess
    connection: Connection
    began: float


def run_jobs(jobs: Sequence[DeviceJob], at_once: int, ended: Callable[[DeviceJob, Ended], None]) -> bool:
    """Run the jobs in order, some at once, telling ``ended`` of each. True if interrupted by Ctrl-C."""
    waiting, running = list(jobs), list[_Running]()
    try:
        while waiting or running:
            while waiting and len(running) < at_once:
                running.append(_start(waiting.pop(0)))
            for handle in wait([started.process.sentinel for started in running]):
                started = next(started for started in running if started.process.sentinel == handle)
                running.remove(started)
                ended(started.job, _end_of(started))
    except KeyboardInterrupt:
        for started in running:
            started.process.terminate()  # calibrate takes it for Ctrl-C
        for started in running:
            started.process.join(LAST_WORDS_SECONDS)
            started.process.kill()
            ended(started.job, _end_of(started, interrupted=True))
        return True
    return False


def _start(job: DeviceJob) -> _Running:
    context = multiprocessing.get_context("spawn")
    receiver, sender = context.Pipe(duplex=False)
    process = context.Process(target=_calibrate, args=(job, sender), name=job.name)
    with inherited_by_workers():
        process.start()
    sender.close()
    return _Running(job, process, receiver, time.monotonic())


def _end_of(started: _Running, interrupted: bool = False) -> Ended:
    started.process.join()
    try:
        code, reason = started.connection.recv()
    except EOFError:  # it could not even say so
        code, reason = 1, f"its process ended with code {started.process.exitcode}"
        if interrupted:
            code, reason = 130, "interrupted"
        elif started.job.log.exists():
            reason += f"; see {started.job.log}"
    started.connection.close()
    return Ended(code, reason, time.monotonic() - started.began)


def _calibrate(job: DeviceJob, connection: Connection) -> None:
    """In the device's process: its words go to the log, its end to the connection."""
    signal.signal(signal.SIGTERM, signal.default_int_handler)
    with open_own(job.log, truncate=True) as log:
        for stream in (sys.stdout, sys.stderr):
            stream.flush()
            os.dup2(log.fileno(), stream.fileno())
        with plain_streams():
            code, reason = _outcome(job)
            if reason:
                print(f"error: {one_line(reason)}", file=sys.stderr)
        sys.stdout.flush()
        sys.stderr.flush()
    connection.send((code, reason))


def _outcome(job: DeviceJob) -> tuple[int, str]:
    from fisheye_ep_calib.commands.calibrate import run
    from fisheye_ep_calib.commands.messages import show_messages, with_options

    prepare_worker()
    show_messages()
    try:
        code = run(job.arguments)
        return code, "" if code == 0 else f"not all of its cameras could be calibrated; see {job.log}"
    except CalibrationError as error:
        return error.exit_code, with_options(str(error), job.arguments)
    except KeyboardInterrupt:
        return 130, "interrupted"
    except Exception as error:  # a defect: its traceback is in the log, and the other devices go on
        traceback.print_exc()
        return 1, f"{type(error).__name__}: {error}; see {job.log}"
