"""When an image was taken, and when it was recorded."""

from __future__ import annotations

import cv2
from bag_writers import IMAGE, ROS2, START_NS, images, serialize
from rosbags.rosbag2 import Writer

from fisheye_ep_calib.storage.recording import open_recording


def test_an_image_is_recorded_later_than_it_was_taken(tmp_path) -> None:
    with Writer(tmp_path / "bag", version=9) as writer:
        connection = writer.add_connection("/front/image_raw", IMAGE, typestore=ROS2)
        for number, image in enumerate(images(3)):
            taken = START_NS + number * 10**8
            writer.write(connection, taken + 30_000_000 + number, serialize(IMAGE, image, taken))
    with open_recording(tmp_path / "bag") as recording:
        frames = list(recording.frames())
        assert [frame.taken_ns for frame in frames] == [START_NS + number * 10**8 for number in range(3)]
        assert [frame.stamp_ns - frame.taken_ns for frame in frames] == [30_000_000, 30_000_001, 30_000_002]


def test_image_files_are_numbered(tmp_path) -> None:
    for number, image in enumerate(images(2)):
        cv2.imwrite(str(tmp_path / f"{number}.png"), image)
    with open_recording(tmp_path) as recording:
        assert [frame.taken_ns for frame in recording.frames()] == [0, 1]
