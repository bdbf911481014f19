"""A bag played to the node `calibrator`, a process of its own, over real DDS; what it publishes is handed back."""

from __future__ import annotations

import contextlib
import importlib.util
import json
import os
import signal
import subprocess
import sys
import threading
import time
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any

import yaml

from fisheye_ep_calib.errors import CalibrationError, first_line

NODE = "calibrator"
START_SECONDS = 60.0
CALIBRATE_SECONDS = 120.0
END_SECONDS = 15.0
SETTLE_SECONDS = 2.5  # after which the last images have been looked at, and the status says so
ENOUGH_VIEWS = 20  # of each camera; a busy machine looks at fewer of the images, so they are played again
MOST_TIMES = 4


@dataclass(frozen=True)
class LiveRun:
    """What came back: the service's answer and, for each camera, its sensor_msgs/CameraInfo."""

    answer: str
    infos: dict[str, Any]


def why_not_live() -> str:
    """Why the node cannot be started here; empty where it can."""
    if importlib.util.find_spec("rclpy") is None:
        return "rclpy is not installed"
    os.environ.setdefault("AMENT_PREFIX_PATH", sys.prefix)
    try:
        import rclpy  # noqa: F401
        import sensor_msgs.msg  # noqa: F401
        import std_srvs.srv  # noqa: F401
    except (ImportError, OSError) as error:
        return f"rclpy does not start ({first_line(error)})"
    return ""


def play_to_calibrator(
    bag: Path, cameras: Sequence[str], target_file: Path, folder: Path, model: str, say: Callable[[str], None]
) -> LiveRun:
    """Start the node, play the bag to it at the speed it was recorded until it has views enough, have it calibrate.

    The node writes into ``folder``/live and its log into ``folder``/calibrator.log. It runs in a DDS domain of its
    own that does not leave this machine. Raises CalibrationError where the node fails.
    """
    os.environ["ROS_DOMAIN_ID"] = str(1 + (os.getpid() * 31 + time.time_ns()) % 100)
    os.environ["ROS_AUTOMATIC_DISCOVERY_RANGE"] = "LOCALHOST"
    parameters = folder / "calibrator.yaml"
    parameters.write_text(_parameters(cameras, target_file, folder / "live", model), encoding="utf-8")
    log = folder / "calibrator.log"
    with _running_node(parameters, log) as process, _Player(cameras) as player:
        _wait(player.connected, START_SECONDS, "the node to listen", process, log)
        say(f"node {NODE} listens; playing {bag.name}")
        player.play(bag, lambda: _check(process, log))
        for _ in range(MOST_TIMES - 1):
            if min(player.views.values()) >= ENOUGH_VIEWS:
                break
            kept = ", ".join(f"{name} {views}" for name, views in player.views.items())
            say(f"views kept so far: {kept}; playing it again")
            player.play(bag, lambda: _check(process, log))
        say(f"calling /{NODE}/calibrate")
        answer = player.calibrate()
        _wait(answer.done, CALIBRATE_SECONDS, "the calibration", process, log)
        response = answer.result()
        if not response.success:
            raise CalibrationError(f"the node could not calibrate: {response.message}; see {log}")
        _wait(lambda: len(player.infos) == len(cameras), START_SECONDS, "CameraInfo", process, log)
        return LiveRun(response.message, dict(player.infos))


def _parameters(cameras: Sequence[str], target_file: Path, output: Path, model: str) -> str:
    """The node's parameter file."""
    values: dict[str, Any] = {
        "cameras": list(cameras),
        "target": str(target_file.resolve()),
        "model": model,
        "output_directory": str(output.resolve()),
        "resume": False,
        "auto_calibrate": False,
    }
    values |= {camera: {"topic": f"/{camera}/image_raw"} for camera in cameras}
    return yaml.safe_dump({NODE: {"ros__parameters": values}}, sort_keys=False)


@contextlib.contextmanager
def _running_node(parameters: Path, log: Path) -> Iterator[subprocess.Popen[bytes]]:
    """The node as a process that is ended on the way out, by Ctrl-C as a user would end it."""
    command = [sys.executable, "-m", "fisheye_ep_calib.ros.calibrator", "--ros-args"]
    command += ["--params-file", str(parameters)]
    with open(log, "wb") as file:
        process = subprocess.Popen(command, stdout=file, stderr=subprocess.STDOUT, start_new_session=True)
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


def _check(process: subprocess.Popen[bytes], log: Path) -> None:
    if process.poll() is not None:
        lines = log.read_text(encoding="utf-8", errors="replace").strip().splitlines() or ["it said nothing"]
        raise CalibrationError(f"the node ended by itself: {lines[-1]}; see {log}")


def _wait(
    condition: Callable[[], bool], seconds: float, what: str, process: subprocess.Popen[bytes], log: Path
) -> None:
    give_up = time.monotonic() + seconds
    while not condition():
        _check(process, log)
        if time.monotonic() > give_up:
            raise CalibrationError(f"waited {seconds:.0f} s in vain for {what}; see {log}")
        time.sleep(0.05)


class _Player:
    """A ROS node beside the calibrator: publishes the bag's images, calls, and collects CameraInfo."""

    def __init__(self, cameras: Sequence[str]) -> None:
        import rclpy
        from rclpy.executors import SingleThreadedExecutor
        from rclpy.qos import QoSProfile, ReliabilityPolicy
        from sensor_msgs.msg import CameraInfo, Image
        from std_msgs.msg import String
        from std_srvs.srv import Trigger

        self._context = rclpy.Context()
        rclpy.init(args=[], context=self._context)
        self._node = rclpy.create_node("bag_player", context=self._context)
        quality = QoSProfile(depth=10, reliability=ReliabilityPolicy.RELIABLE)
        self._publishers = {
            f"/{camera}/image_raw": self._node.create_publisher(Image, f"/{camera}/image_raw", quality)
            for camera in cameras
        }
        self.infos: dict[str, Any] = {}
        self.views = dict.fromkeys(cameras, 0)  # that the node has kept
        self._node.create_subscription(String, f"/{NODE}/status", self._receive_status, quality)
        for camera in cameras:
            self._node.create_subscription(
                CameraInfo, f"/{camera}/camera_info", partial(self._receive, camera), quality
            )
        self._client = self._node.create_client(Trigger, f"/{NODE}/calibrate")
        self._request = Trigger.Request
        self._executor = SingleThreadedExecutor(context=self._context)
        self._executor.add_node(self._node)
        self._thread = threading.Thread(target=self._spin, daemon=True)
        self._thread.start()

    def __enter__(self) -> _Player:
        return self

    def __exit__(self, *_: object) -> None:
        self._context.try_shutdown()
        self._thread.join(5)
        self._executor.shutdown()
        self._node.destroy_node()

    def _spin(self) -> None:
        from rclpy.executors import ExternalShutdownException

        with contextlib.suppress(ExternalShutdownException):
            self._executor.spin()

    def _receive(self, camera: str, info: Any) -> None:
        self.infos[camera] = info

    def _receive_status(self, status: Any) -> None:
        for name, camera in json.loads(status.data)["cameras"].items():
            self.views[name] = camera["views"]

    def connected(self) -> bool:
        """Whether the calibrator listens to every camera and serves."""
        listening = all(publisher.get_subscription_count() for publisher in self._publishers.values())
        return listening and self._client.service_is_ready()

    def play(self, bag: Path, check: Callable[[], None]) -> None:
        """Publish the bag's images, serialized as they are, at the times at which they were recorded."""
        from mcap.reader import make_reader

        with open(bag, "rb") as file:
            began = first = None
            for _, channel, message in make_reader(file).iter_messages(topics=list(self._publishers)):
                check()
                if began is None or first is None:
                    began, first = time.monotonic(), message.log_time
                time.sleep(max(0.0, began + (message.log_time - first) * 1e-9 - time.monotonic()))
                self._publishers[channel.topic].publish(message.data)
        time.sleep(SETTLE_SECONDS)

    def calibrate(self) -> Any:
        """Call the node's service; a future."""
        return self._client.call_async(self._request())
