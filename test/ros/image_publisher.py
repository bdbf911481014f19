"""A camera driver for tests: a process that publishes the images of an .npz file, over and over, until it is ended.

python image_publisher.py IMAGES.npz RATE [--best-effort] [--compressed] [--frames N] TOPIC...
"""

from __future__ import annotations

import argparse
import array
import time

import cv2
import numpy as np
import rclpy
from rclpy.qos import QoSProfile, ReliabilityPolicy
from sensor_msgs.msg import CompressedImage, Image


def messages(images: np.ndarray, compressed: bool) -> list:
    """One message an image, made beforehand: publishing is all that happens later."""
    made = []
    for image in images:
        if compressed:
            content = cv2.imencode(".jpg", image, [cv2.IMWRITE_JPEG_QUALITY, 95])[1].tobytes()
            made.append(CompressedImage(format="jpeg", data=array.array("B", content)))
            continue
        height, width = image.shape
        data = array.array("B", image.tobytes())
        made.append(Image(height=height, width=width, encoding="mono8", step=width, data=data))
    return made


def main() -> None:
    parser = argparse.ArgumentParser()
    parser.add_argument("images")
    parser.add_argument("rate", type=float)
    parser.add_argument("topics", nargs="+")
    parser.add_argument("--best-effort", action="store_true")
    parser.add_argument("--compressed", action="store_true")
    parser.add_argument("--frames", type=int, default=2**31)
    arguments = parser.parse_args()
    rclpy.init(args=[])
    node = rclpy.create_node("driver")
    reliability = ReliabilityPolicy.BEST_EFFORT if arguments.best_effort else ReliabilityPolicy.RELIABLE
    kind = CompressedImage if arguments.compressed else Image
    quality = QoSProfile(depth=10, reliability=reliability)
    publishers = [node.create_publisher(kind, topic, quality) for topic in arguments.topics]
    made = messages(np.load(arguments.images)["images"], arguments.compressed)
    while not all(publisher.get_subscription_count() for publisher in publishers):
        time.sleep(0.02)
    following = time.monotonic()
    for frame in range(arguments.frames):
        for number, publisher in enumerate(publishers):
            message = made[(frame + number) % len(made)]
            message.header.frame_id = f"camera_{number}"
            message.header.stamp = node.get_clock().now().to_msg()
            publisher.publish(message)
        following += 1 / arguments.rate
        time.sleep(max(0.0, following - time.monotonic()))
    print(arguments.frames, flush=True)
    time.sleep(2.0)  # reliable messages may still be on their way


if __name__ == "__main__":
    try:
        main()
    except (KeyboardInterrupt, rclpy.executors.ExternalShutdownException):
        pass
