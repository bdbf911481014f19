"""A program beside the node ``calibrator``: plays a bag to it, has it calibrate, and prints what it hears.

A JSON object a line: {"say": text} on the way; at the end {"answer": text, "infos": camera → CameraInfo}, or
{"failed": text}.
"""

from __future__ import annotations

import argparse
import json
import sys
import threading
import time
from collections.abc import Callable, Sequence
from functools import partial
from pathlib import Path
from typing import Any

import rclpy
from mcap.reader import make_reader
from rclpy.executors import ExternalShutdownException, SingleThreadedExecutor
from rclpy.qos import QoSProfile, ReliabilityPolicy
from sensor_msgs.msg import CameraInfo, Image
from std_msgs.msg import String
from std_srvs.srv import Trigger

from fisheye_ep_calib.outside import open_outside

START_SECONDS = 60.0
CALIBRATE_SECONDS = 600.0  # on a machine with much else to do; a node that has died is told at once
SETTLE_SECONDS = 2.5  # after which the last images have been looked at, and the status says so


class Failed(Exception):
    """What was waited for has not come."""


class BagPlayer:
    """Publishes the bag's images, calls, and collects CameraInfo."""

    def __init__(self, node: str, cameras: Sequence[str]) -> None:
        rclpy.init(args=[])
        self._node = rclpy.create_node("bag_player")
        quality = QoSProfile(depth=10, reliability=ReliabilityPolicy.RELIABLE)
        self._publishers = {
            f"/{camera}/image_raw": self._node.create_publisher(Image, f"/{camera}/image_raw", quality)
            for camera in cameras
        }
        self.infos: dict[str, Any] = {}
        self.views = dict.fromkeys(cameras, 0)  # that the node has kept
        self._node.create_subscription(String, f"/{node}/status", self._receive_status, quality)
        for camera in cameras:
            self._node.create_subscription(
                CameraInfo, f"/{camera}/camera_info", partial(self._receive, camera), quality
            )
        self._client = self._node.create_client(Trigger, f"/{node}/calibrate")
        self._executor = SingleThreadedExecutor()
        self._executor.add_node(self._node)
        threading.Thread(target=self._spin, daemon=True).start()

    def _spin(self) -> None:
        try:
            self._executor.spin()
        except ExternalShutdownException:
            pass

    def _receive(self, camera: str, info: Any) -> None:
        self.infos[camera] = info

    def _receive_status(self, status: Any) -> None:
        for name, camera in json.loads(status.data)["cameras"].items():
            self.views[name] = camera["views"]

    def connected(self) -> bool:
        """Whether the calibrator listens to every camera and serves."""
        listening = all(publisher.get_subscription_count() for publisher in self._publishers.values())
        return listening and self._client.service_is_ready()

    def play(self, bag: Path) -> None:
        """Publish the bag's images, serialized as they are, at the times at which they were recorded."""
        with open_outside(bag, "bag") as file:
            began = first = None
            for _, channel, message in make_reader(file).iter_messages(topics=list(self._publishers)):
                if began is None or first is None:
                    began, first = time.monotonic(), message.log_time
                time.sleep(max(0.0, began + (message.log_time - first) * 1e-9 - time.monotonic()))
                self._publishers[channel.topic].publish(message.data)
        time.sleep(SETTLE_SECONDS)

    def calibrate(self) -> Any:
        """Call the node's service; its answer."""
        answer = self._client.call_async(Trigger.Request())
        wait(answer.done, CALIBRATE_SECONDS, "the calibration")
        return answer.result()


def wait(condition: Callable[[], bool], seconds: float, what: str) -> None:
    give_up = time.monotonic() + seconds
    while not condition():
        if time.monotonic() > give_up:
            raise Failed(f"waited {seconds:.0f} s in vain for {what}")
        time.sleep(0.05)


def played(player: BagPlayer, arguments: argparse.Namespace) -> dict[str, Any]:
    """Play until each camera has views enough, and calibrate."""
    wait(player.connected, START_SECONDS, "the node to listen")
    tell(say=f"node {arguments.node} listens; playing {arguments.bag.name}")
    player.play(arguments.bag)
    for _ in range(arguments.most_times - 1):
        if min(player.views.values()) >= arguments.enough_views:
            break
        kept = ", ".join(f"{name} {views}" for name, views in player.views.items())
        tell(say=f"views kept so far: {kept}; playing it again")
        player.play(arguments.bag)
    tell(say=f"calling /{arguments.node}/calibrate")
    answer = player.calibrate()
    if not answer.success:
        raise Failed(f"the node could not calibrate: {answer.message}")
    wait(lambda: len(player.infos) == len(player.views), START_SECONDS, "CameraInfo")
    return {"answer": answer.message, "infos": {name: plain(info) for name, info in player.infos.items()}}


def plain(info: Any) -> dict[str, Any]:
    """A CameraInfo's main fields."""
    return {
        "stamp": f"{info.header.stamp.sec}.{info.header.stamp.nanosec:09d}",
        "frame_id": info.header.frame_id,
        "width": info.width,
        "height": info.height,
        "distortion_model": info.distortion_model,
        "d": list(info.d),
        "k": list(map(float, info.k)),
        "p": list(map(float, info.p)),
    }


def tell(**content: Any) -> None:
    print(json.dumps(content), flush=True)


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("bag", type=Path)
    parser.add_argument("cameras", nargs="+")
    parser.add_argument("--node", required=True)
    parser.add_argument("--enough-views", type=int, required=True, help="of each camera")
    parser.add_argument("--most-times", type=int, required=True, help="that the bag is played")
    arguments = parser.parse_args()
    player = BagPlayer(arguments.node, arguments.cameras)
    try:
        tell(**played(player, arguments))
    except Failed as error:
        tell(failed=str(error))
    rclpy.try_shutdown()
    return 0


if __name__ == "__main__":
    sys.exit(main())
