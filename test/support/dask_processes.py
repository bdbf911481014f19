"""A Dask scheduler and its workers as processes of this machine."""

from __future__ import annotations

import json
import os
import subprocess
import sys
import time
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path

import fisheye_ep_calib

PACKAGE = Path(fisheye_ep_calib.__file__).parents[1]


@contextmanager
def _processes(commands: list[list[str]], environment: dict[str, str]) -> Iterator[list[subprocess.Popen]]:
    started = [
        subprocess.Popen(command, env=environment, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
        for command in commands
    ]
    try:
        yield started
    finally:
        for process in started:
            process.kill()
        for process in started:
            process.wait()


@contextmanager
def scheduler(folder: Path, started: list[subprocess.Popen] | None = None) -> Iterator[str]:
    """A scheduler's address; it lives as long as the block. started: is given its process."""
    address_file = folder / "scheduler.json"
    words = [sys.executable, "-m", "distributed.cli.dask_scheduler", "--host", "127.0.0.1", "--port", "0"]
    words += ["--no-dashboard", "--scheduler-file", str(address_file)]
    with _processes([words], {**os.environ, "OMP_NUM_THREADS": "1"}) as processes:
        if started is not None:
            started += processes
        end = time.monotonic() + 60
        while not address_file.exists() or '"address"' not in address_file.read_text():
            assert time.monotonic() < end
            time.sleep(0.05)
        yield json.loads(address_file.read_text())["address"]


@contextmanager
def workers(address: str, count: int, *, nanny=False, paths: Sequence[Path] = ()) -> Iterator[list[subprocess.Popen]]:
    """Worker processes with one thread each; with a nanny they are started again when they die."""
    from distributed import Client

    words = [sys.executable, "-m", "distributed.cli.dask_worker", address, "--nthreads", "1", "--no-dashboard"]
    words.append("--nanny" if nanny else "--no-nanny")
    search = os.pathsep.join(map(str, [*paths, PACKAGE]))
    with _processes([words] * count, {**os.environ, "PYTHONPATH": search, "OMP_NUM_THREADS": "1"}) as started:
        client = Client(address, set_as_default=False)
        client.wait_for_workers(count, timeout=60)
        client.close()
        yield started
