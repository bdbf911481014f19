"""A bag played to the node `calibrator` over real DDS; what it publishes is handed back.

The node and what plays the bag are processes of their own, in an environment of their own.
"""

from __future__ import annotations

import contextlib
import importlib.util
import json
import os
import queue
import signal
import subprocess
import sys
import threading
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import IO, Any, BinaryIO

import yaml

from fisheye_ep_calib.errors import CalibrationError
from fisheye_ep_calib.outside import real_path
from fisheye_ep_calib.storage.atomic import atomic_write
from fisheye_ep_calib.storage.held import open_own

NODE = "calibrator"
END_SECONDS = 15.0
ENOUGH_VIEWS = 20  # of each camera; a busy machine looks at fewer of the images, so they are played again
MOST_TIMES = 4


@dataclass(frozen=True)
class LiveRun:
    """What came back: the service's answer and, for each camera, the fields of its CameraInfo."""

    answer: str
    infos: dict[str, dict[str, Any]]


def why_not_live() -> str:
    """Why the node cannot be started here; empty where it can."""
    if importlib.util.find_spec("rclpy") is None:
        return "rclpy is not installed"
    imports = [sys.executable, "-c", "import rclpy, sensor_msgs.msg, std_srvs.srv"]
    ended = subprocess.run(imports, env=_environment(), capture_output=True, text=True)
    if ended.returncode:
        return f"rclpy does not start ({(ended.stderr.strip().splitlines() or ['it says nothing'])[-1]})"
    return ""


def _environment() -> dict[str, str]:
    """For programs that use ROS: a DDS domain that does not leave this machine, of one demo alone."""
    return {
        "AMENT_PREFIX_PATH": sys.prefix,
        **os.environ,
        "ROS_DOMAIN_ID": str(1 + (os.getpid() * 31 + time.time_ns()) % 100),
        "ROS_AUTOMATIC_DISCOVERY_RANGE": "LOCALHOST",
    }


def play_to_calibrator(
    bag: Path, cameras: Sequence[str], target_file: Path, folder: Path, model: str, say: Callable[[str], None]
) -> LiveRun:
    """Start the node, play the bag to it at the speed it was recorded until it has views enough, have it calibrate.

    The node writes into ``folder``/live and its log into ``folder``/calibrator.log. Raises CalibrationError where
    the node fails.
    """
    parameters, log = folder / "calibrator.yaml", folder / "calibrator.log"
    atomic_write(parameters, _parameters(cameras, target_file, folder / "live", model).encode())
    node = ["fisheye_ep_calib.ros.calibrator", "--ros-args", "--params-file", str(parameters)]
    player = ["fisheye_ep_calib.ros.bag_player", str(bag), *cameras, "--node", NODE]
    player += ["--enough-views", str(ENOUGH_VIEWS), "--most-times", str(MOST_TIMES)]
    environment = _environment()
    with (
        _log_file(log) as log_file,
        _running(node, environment, log_file) as running,
        _running(player, environment, log_file, subprocess.PIPE) as playing,
    ):
        for told in _lines(playing, lambda: _check(running, log)):
            if "say" in told:
                say(told["say"])
            elif "failed" in told:
                raise CalibrationError(f"{told['failed']}; see {log}")
            else:
                return LiveRun(told["answer"], told["infos"])
    raise CalibrationError(f"what plays the bag ended by itself; see {log}")


def _log_file(path: Path) -> BinaryIO:
    try:
        return open_own(path, truncate=True)
    except OSError as error:
        raise CalibrationError(f"cannot write {path}: {error.strerror or error}") from None


def _parameters(cameras: Sequence[str], target_file: Path, output: Path, model: str) -> str:
    """The node's parameter file."""
    values: dict[str, Any] = {
        "cameras": list(cameras),
        "target": str(real_path(target_file)),
        "model": model,
        "output_directory": str(real_path(output)),
        "resume": False,
        "auto_calibrate": False,
    }
    values |= {camera: {"topic": f"/{camera}/image_raw"} for camera in cameras}
    return yaml.safe_dump({NODE: {"ros__parameters": values}}, sort_keys=False)


@contextlib.contextmanager
def _running(
    module: Sequence[str], environment: Mapping[str, str], log: IO[bytes], output: int | None = None
) -> Iterator[subprocess.Popen[bytes]]:
    """A module as a process that is ended on the way out, by Ctrl-C as a user would end it."""
    process = subprocess.Popen(
        [sys.executable, "-m", *module],
        env=environment,
        stdout=log if output is None else output,
        stderr=log,
        start_new_session=True,
    )
    try:
        yield process
    finally:
        if process.poll() is None:
            process.send_signal(signal.SIGINT)
        try:
            process.wait(END_SECONDS)
        except subprocess.TimeoutExpired:
            process.kill()
            process.wait()


def _lines(process: subprocess.Popen[bytes], check: Callable[[], None]) -> Iterator[dict[str, Any]]:
    """The JSON objects that a process prints, until it ends; ``check`` is called while none comes."""
    lines: queue.Queue[bytes] = queue.Queue()

    def read() -> None:
        assert process.stdout is not None
        with process.stdout as stream:
            for line in stream:
                lines.put(line)
        lines.put(b"")

    threading.Thread(target=read, daemon=True).start()
    while True:
        try:
            line = lines.get(timeout=0.2)
        except queue.Empty:
            check()
            continue
        if not line:
            return
        yield json.loads(line)


def _check(process: subprocess.Popen[bytes], log: Path) -> None:
    if process.poll() is not None:
        lines = log.read_text(encoding="utf-8", errors="replace").strip().splitlines() or ["it said nothing"]
        raise CalibrationError(f"the node ended by itself: {lines[-1]}; see {log}")
