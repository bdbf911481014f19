"""Messages that lie, images that explode, names that climb out of folders: counted, told once, survived."""

from __future__ import annotations

import array
import json
import re
import struct
import zlib
from pathlib import Path

import cv2
import numpy as np
import pytest
from builtin_interfaces.msg import Time
from live_processes import LATCHED, wait_for
from rclpy.qos import QoSProfile, ReliabilityPolicy
from sensor_msgs.msg import CompressedImage, Image
from std_msgs.msg import String

pytestmark = pytest.mark.live

REPOSITORY = Path(__file__).resolve().parents[2]
TARGET = REPOSITORY / "config" / "targets" / "circle_grid_11x7.yaml"
KEEP_ALL = QoSProfile(depth=50, reliability=ReliabilityPolicy.RELIABLE)


def raw(height: int, width: int, step: int, encoding: str = "mono8", data: bytes = bytes(100)) -> Image:
    return Image(height=height, width=width, step=step, encoding=encoding, data=array.array("B", data))


def jpeg(image: np.ndarray, *options: int) -> bytes:
    return bytes(cv2.imencode(".jpg", image, options)[1].tobytes())


def jpeg_of_many_scans(scans: int) -> bytes:
    """A progressive JPEG whose last scan is repeated: each costs as much as the picture."""
    content = jpeg(np.full((1000, 1000), 128, np.uint8), cv2.IMWRITE_JPEG_PROGRESSIVE, 1)
    last = content.rfind(b"\xff\xda")
    return content[:last] + content[last:-2] * scans + content[-2:]


def png_bomb(side: int) -> bytes:
    def chunk(kind: bytes, content: bytes) -> bytes:
        body = kind + content
        return struct.pack(">I", len(content)) + body + struct.pack(">I", zlib.crc32(body))

    header = struct.pack(">IIBBBBB", side, side, 8, 0, 0, 0, 0)
    pixels = zlib.compress(bytes(10_000_000), 9)
    signature = b"\x89PNG\r\n\x1a\n"
    return signature + chunk(b"IHDR", header) + chunk(b"IDAT", pixels) + chunk(b"IEND", b"")


RAW = [
    raw(10, 10, 10, encoding="\x1b[31mmono8\nERROR\x07" * 1000),  # the first is the one that is told
    raw(2048, 2048, 2048),
    raw(0, 0, 0, data=b""),
    raw(10, 10, 2**31),
    raw(2**32 - 1, 2**32 - 1, 2**32 - 1),
    raw(10, 10, 10, encoding="../../etc/passwd"),
    raw(10, 10, 10, encoding=""),
    raw(10, 3, 2, encoding="rgb8"),
    raw(1, 1, 1, data=b""),
    raw(10, 10, 10, encoding="mono8" * 5000),
    raw(10, 10, 10, encoding="mono16"),
    raw(10, 10, 10, encoding="32FC1"),
    raw(65535, 65535, 65535, encoding="bayer_rggb8"),
    raw(10, 10, 10, encoding="8UC0"),
    raw(10, 10, 10, encoding="8UC99999999999999999999"),
]
# What can be read, and shows nothing.
EMPTY = [
    raw(11, 9, 9, encoding="bayer_rggb8", data=bytes(99)),
    raw(10, 5, 10, encoding="mono16", data=b"\xff" * 100),
    *[
        raw(50, 50, 200, encoding="32FC1", data=np.full(2500, value, "f4").tobytes())
        for value in (np.nan, np.inf, 3e38)
    ],
    raw(1, 1, 1, data=b"x"),
    raw(1, 100, 100),
]
COMPRESSED = [
    CompressedImage(format="jpeg", data=array.array("B", content))
    for content in (
        b"",
        b"garbage" * 1000,
        b"\xff\xd8\xff\xe0" + bytes(range(256)) * 20 + b"\xff\xd9",
        png_bomb(30000),
        png_bomb(60000),
        jpeg(np.eye(200, dtype=np.uint8) * 255)[:-400],
        jpeg_of_many_scans(5000),
        b"\x89PNG\r\n\x1a\n",
    )
]


def test_hostile_messages_are_counted_told_once_and_survived(start_calibrator, probe, rendered, tmp_path) -> None:
    folder = tmp_path / "deep" / "calibration"
    calibrator = start_calibrator(
        cameras="[front, rear]",
        rear__transport="compressed",
        target=TARGET,
        output_directory=folder,
    )
    statuses = probe.collect(String, "/calibrator/status", LATCHED)
    front = probe.node.create_publisher(Image, "/front/image_raw", KEEP_ALL)
    rear = probe.node.create_publisher(CompressedImage, "/rear/image_raw/compressed", KEEP_ALL)
    wait_for(lambda: front.get_subscription_count() and rear.get_subscription_count(), "the node's subscriptions")

    def unreadable(camera: str) -> int:
        return json.loads(statuses[-1].data)["cameras"][camera]["unreadable"] if statuses else 0

    for number in range(max(len(RAW), len(COMPRESSED))):
        sent = {"front": RAW[: number + 1], "rear": COMPRESSED[: number + 1]}
        for publisher, messages in ((front, RAW), (rear, COMPRESSED)):
            for message in messages[number : number + 1]:
                message.header.frame_id = "../../../../tmp/evil"
                publisher.publish(message)
        wait_for(
            lambda sent=sent: all(unreadable(camera) == len(messages) for camera, messages in sent.items()), str(number)
        )

    def looked_at() -> int:
        return json.loads(statuses[-1].data)["cameras"]["front"]["searched"]

    already = looked_at()
    for number, message in enumerate(EMPTY):
        message.header.stamp = [Time(), Time(sec=-(2**31)), Time(sec=2**31 - 1, nanosec=2**32 - 1)][number % 3]
        message.header.frame_id = "\x1b[31mevil\n\x07" * 1000
        front.publish(message)
        wait_for(lambda number=number: looked_at() > already + number, f"front {number} of what shows nothing")

    image = np.load(rendered)["images"][0]
    good = raw(*image.shape, image.shape[1], data=image.tobytes())
    good.header.frame_id = "../../../../tmp/evil\x1b[31m\n" * 500
    front.publish(good)
    calibrator.wait_to_say("front: view 1 kept")
    assert calibrator.output.count("front: a frame is skipped") == 1
    assert calibrator.output.count("rear: a frame is skipped") == 1
    assert "Traceback" not in calibrator.output
    assert not re.search(r"[\x00-\x08\x0b-\x1f\x7f]", calibrator.output) and "\nERROR" not in calibrator.output
    assert max(map(len, calibrator.output.splitlines())) < 500
    assert unreadable("front") == len(RAW) and unreadable("rear") == len(COMPRESSED)
    assert calibrator.interrupt()[0] == 0
    written = {path.relative_to(tmp_path) for path in tmp_path.rglob("*") if path.is_file()}
    assert {str(path) for path in written if "rendered" not in str(path)} == {"deep/calibration/front.npz"}


def test_an_image_of_another_size_is_told_once_and_skipped(start_calibrator, probe, rendered, tmp_path) -> None:
    calibrator = start_calibrator(cameras="[front]", target=TARGET, output_directory=tmp_path)
    front = probe.node.create_publisher(Image, "/front/image_raw", KEEP_ALL)
    wait_for(front.get_subscription_count, "the node's subscription")
    images = np.load(rendered)["images"]

    def publish(image: np.ndarray) -> None:
        front.publish(raw(*image.shape, image.shape[1], data=image.tobytes()))

    publish(images[0])
    calibrator.wait_to_say("front: view 1 kept")
    publish(images[1][:1000])
    calibrator.wait_to_say("images are 1024×1000 now")
    publish(images[2][:1000])
    publish(images[3])
    calibrator.wait_to_say("front: view 2 kept")
    assert calibrator.output.count("now, the kept views") == 1
