"""Looking at images on a Dask cluster, whose workers read the recording by themselves, at the same path.

What a worker that dies had in hand is looked at again by another one, so that it costs time, not images.
"""

from __future__ import annotations

import asyncio  # whose TimeoutError is another one before Python 3.11
import logging
import os
import pickle
import re
import sys
import threading
import time
import uuid
from collections import deque
from collections.abc import Callable, Iterable, Iterator
from concurrent.futures import CancelledError
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import cv2
import numpy as np

from fisheye_ep_calib.collection.look import Job, failed_on
from fisheye_ep_calib.collection.look_in_time import LookInTime
from fisheye_ep_calib.collection.results import FrameResult
from fisheye_ep_calib.errors import CalibrationError, InputError, first_line
from fisheye_ep_calib.storage.recording import Recording
from fisheye_ep_calib.target.base import Target
from fisheye_ep_calib.version import __version__

PACKAGE = "fisheye_ep_calib[cluster]"
_ADDRESS = re.compile(r"(tcp|tls|wss?|ucx|inproc)://\S+|[^\s/:]+:\d+$")
CONNECT_SECONDS = 7
ANSWER_SECONDS = 60  # for a cluster without workers, or out of reach, before it is given up
CHECK_SECONDS = 2
QUEUED_A_THREAD = 3


class ClusterWorkers:
    """The workers of a Dask scheduler, for one recording and one target."""

    def __init__(self, recording: Recording, target: Target, scheduler: str) -> None:
        """Raises InputError where the cluster cannot be reached, or cannot read the recording."""
        self._recording = recording
        self._scheduler = scheduler
        self._search = uuid.uuid4().hex, pickle.dumps((recording, target))
        self._waiting: deque[Job] = deque()
        self._running: dict[Any, Job] = {}
        self._suspects: deque[Job] = deque()
        self._ready: deque[FrameResult] = deque()
        self._client: Any = None
        self._payload: Any = None
        self._threads, self._last_seen = 0, time.monotonic()
        self._connect()

    def add(self, jobs: Iterable[Job]) -> None:
        """Have these images looked at; more may be added while others are waited for."""
        self._waiting.extend(jobs)
        if self._client is not None:
            with self._told_when_lost():
                self._fill()

    def next_result(self) -> FrameResult | None:
        """What one of the images shows, in no particular order; None once all have been looked at."""
        while not self._ready and (self._waiting or self._running or self._suspects):
            if self._client is None:
                self._connect()
            with self._told_when_lost():
                self._fill()
                self._gather()
        return self._ready.popleft() if self._ready else None

    def close(self) -> None:
        """Forget what waits, and leave the cluster to others."""
        for jobs in (self._waiting, self._running, self._suspects, self._ready):
            jobs.clear()
        client, self._client, self._payload = self._client, None, None
        if client is not None:
            client.close(timeout=CHECK_SECONDS)

    def _connect(self) -> None:
        self._client = _client_of(self._scheduler)
        try:
            self._check_workers()
        except BaseException:
            self.close()
            raise
        self._payload = self._client.submit(_same, self._search[1], pure=False)

    def _check_workers(self) -> None:
        """Raises InputError where no worker is there, or one that cannot look at these images.

        The scheduler must know the package too: it unpacks what is to be done.
        """
        try:
            self._client.wait_for_workers(1, timeout=CONNECT_SECONDS)
            self._client.run_on_scheduler(_what_is_missing, [])
            versions = {"the scheduler": self._client.run_on_scheduler(_versions)}
            versions |= {f"worker {worker}": found for worker, found in self._client.run(_versions).items()}
            lacking = self._client.run(_what_is_missing, [str(path) for path in self._recording.files()])
        except asyncio.TimeoutError:
            raise InputError(
                f"the scheduler at {self._scheduler} has no workers; start some with 'dask worker {self._scheduler}'"
            ) from None
        except Exception as error:  # whatever goes wrong in another program
            raise InputError(
                f"scheduler and workers of {self._scheduler} cannot look at images: {first_line(error)}; "
                "all need fisheye_ep_calib of this version"
            ) from None
        _refuse_other_versions(versions)
        for worker, path in lacking.items():
            if path:
                raise InputError(f"worker {worker} has no {path}: every worker must see the recording at the same path")

    @contextmanager
    def _told_when_lost(self) -> Iterator[None]:
        """Raises CalibrationError for whatever a client raises whose scheduler is gone for good."""
        try:
            yield
        except CalibrationError:
            raise
        except Exception as error:
            if isinstance(error, CancelledError) or self._client.status != "running":
                raise CalibrationError(f"the scheduler at {self._scheduler} is lost") from None
            raise

    def _fill(self) -> None:
        """Keep the workers busy, with something to go on with at once; what may have killed one comes last, alone."""
        if self._threads == 0:
            self._threads = sum(self._asked(self._client.nthreads).values())
        while self._waiting and len(self._running) < QUEUED_A_THREAD * max(self._threads, 1):
            self._submit(self._waiting.popleft())
        if self._suspects and not self._running:
            self._submit(self._suspects[0])

    def _submit(self, job: Job) -> None:
        task = self._client.submit(_look, self._search[0], self._payload, job, pure=False, retries=2)
        self._running[task] = job

    def _gather(self) -> None:
        """Wait for a result, or a while."""
        from distributed import wait

        try:
            with self._client.as_current():
                done = wait(  # type: ignore[no-untyped-call]  # of distributed
                    list(self._running), timeout=CHECK_SECONDS, return_when="FIRST_COMPLETED"
                ).done
        except asyncio.TimeoutError:
            self._check_alive()
            return
        self._last_seen = time.monotonic()
        for task in done:
            job = self._running.pop(task)
            alone = bool(self._suspects) and job is self._suspects[0]
            error = task.exception() if task.status == "error" else None
            if task.status in ("lost", "pending"):  # its worker died before it was asked for the result
                self._submit(job)
            elif _has_killed_its_workers(error) and not alone:
                self._suspects.append(job)
            else:
                self._ready.append(self._outcome(task, job, error))
                if alone:
                    self._suspects.popleft()

    def _outcome(self, task: Any, job: Job, error: BaseException | None) -> FrameResult:
        """Raises CalibrationError where the cluster has not done what it was asked for."""
        if task.status == "finished":
            result: FrameResult = task.result()
            return result
        if _has_killed_its_workers(error):
            return failed_on(self._recording, job, "a worker process died on it")
        why = first_line(error) if error else f"it has given up on an image ({task.status})"
        raise CalibrationError(f"the cluster at {self._scheduler} has failed: {why}")

    def _check_alive(self) -> None:
        """Raises CalibrationError where the cluster has been out of reach, or without workers, for too long."""
        self._threads = sum(self._asked(self._client.nthreads).values())
        if self._threads:
            self._last_seen = time.monotonic()
        elif time.monotonic() - self._last_seen > ANSWER_SECONDS:
            raise CalibrationError(f"the cluster at {self._scheduler} has no workers any more")

    def _asked(self, question: Callable[[], dict[str, Any]]) -> dict[str, Any]:
        """The scheduler's answer; an empty one where it cannot be reached."""
        if self._client.status != "running":
            return {}
        try:
            return question()
        except (OSError, asyncio.TimeoutError):
            return {}


def check_scheduler(address: str) -> None:
    """Raises InputError where no scheduler answers."""
    _client_of(address).close(timeout=CHECK_SECONDS)


def _client_of(address: str) -> Any:
    try:
        from distributed import Client, Security
    except ModuleNotFoundError as error:
        raise InputError(f"`scheduler` needs the Python package {error.name}: pip install '{PACKAGE}'") from None
    # Its own words on workers that come and go are not for the user of a command.
    for name in ("distributed", "distributed.client", "distributed.scheduler", "distributed.core", "distributed.utils"):
        logging.getLogger(name).setLevel(logging.CRITICAL)
    if not _ADDRESS.match(address):  # a client that fails over it would linger
        raise InputError(f"`scheduler` {address!r} is no address such as tcp://HOST:PORT")
    # Of distributed, without types. A client that has no certificates would linger too.
    own = Security().get_connection_args("client")  # type: ignore[no-untyped-call]
    if address.startswith("tls:") and own.get("ssl_context") is None:
        raise InputError(
            f"`scheduler` {address} needs certificates: "
            "set DASK_DISTRIBUTED__COMM__TLS__CA_FILE, …__CLIENT__CERT and …__CLIENT__KEY"
        )
    try:
        return Client(address, timeout=CONNECT_SECONDS, set_as_default=False)  # type: ignore[no-untyped-call]  # its own
    except (OSError, ValueError, TypeError) as error:
        raise InputError(
            f"no Dask scheduler answers at {address} ({first_line(error)}); "
            "start one with 'dask scheduler', or leave out `scheduler`"
        ) from None


def _has_killed_its_workers(error: BaseException | None) -> bool:
    from distributed import KilledWorker

    return isinstance(error, KilledWorker)


# What follows runs on the workers.


def _same(payload: bytes) -> bytes:
    """The search to look for, as a result that the cluster makes again where its holder dies."""
    return payload


def _versions() -> dict[str, str]:
    """Of what must be the same for the same result."""
    python = ".".join(map(str, sys.version_info[:2]))
    return {"fisheye_ep_calib": __version__, "Python": python, "numpy": np.__version__, "OpenCV": cv2.__version__}


def _refuse_other_versions(found: dict[str, dict[str, str]]) -> None:
    """Raises InputError that names the first who has another version of something than this program."""
    for who, theirs in found.items():
        for package, version in _versions().items():
            if theirs[package] != version:
                raise InputError(
                    f"{who} has {package} {theirs[package]}, this program {version}: "
                    "the same result needs the same versions everywhere"
                )


def _what_is_missing(paths: list[str]) -> str:
    """The first of the paths that cannot be read here; empty where all can."""
    for path in paths:
        try:
            Path(path).stat()
        except OSError:
            return path
    return ""


_mine = threading.local()  # a worker may look with several threads; an open file has one position
_GOODBYE_SECONDS = 10.0  # in which an answer is fetched


def _look(search: str, payload: bytes, job: Job) -> FrameResult:
    """Where an image takes without end its answer is that, and the worker ends: its nanny starts another one."""
    cv2.setNumThreads(1)
    if getattr(_mine, "search", None) != search:
        if hasattr(_mine, "recording"):
            _mine.here.close()
            _mine.recording.close()
        _mine.recording, target = pickle.loads(payload)
        _mine.here = LookInTime(_mine.recording, target)
        _mine.search = search
    here: LookInTime = _mine.here
    result = here.look(job)
    if here.given_up == 1:
        goodbye = threading.Timer(_GOODBYE_SECONDS, os._exit, (1,))
        goodbye.daemon = True
        goodbye.start()
    return result
