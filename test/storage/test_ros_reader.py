"""Bags on a machine that has ROS and neither rosbags nor mcap: its own reader and deserializer take over."""

from __future__ import annotations

import sys
from collections.abc import Callable, Iterator
from types import ModuleType, SimpleNamespace

import numpy as np
import pytest
from bag_writers import COMPRESSED_IMAGE, IMAGE, images, messages, serialize, write_db3, write_mcap

from fisheye_ep_calib import InputError
from fisheye_ep_calib.storage import messages as serialized
from fisheye_ep_calib.storage.recording import open_recording
from fisheye_ep_calib.storage.sources.base import Entry
from fisheye_ep_calib.storage.sources.ros_bag import RosBag

TOPIC = "/camera/image_raw"


def rosbag2_over(recorded: list[tuple]) -> ModuleType:
    """What of rosbag2_py (Jazzy) is used, over messages in memory: it is not on PyPI."""
    content = [(topic, serialize(kind, image, stamp), stamp, kind) for topic, stamp, kind, image in recorded]

    class SequentialReader:
        def open(self, storage, converter) -> None:
            assert storage.storage_id in ("mcap", "sqlite3") and converter.args == ("cdr", "cdr")
            if storage.uri.endswith("broken.mcap"):
                raise RuntimeError("No storage could be initialized from the inputs.\nmore")
            self.left, self.topics = list(content), None

        def get_all_topics_and_types(self):
            kinds = {
                topic: kind if kind in (IMAGE, COMPRESSED_IMAGE) else "std_msgs/msg/String"
                for topic, _, _, kind in content
            }
            return [SimpleNamespace(name=topic, type=kind, serialization_format="cdr") for topic, kind in kinds.items()]

        def set_filter(self, storage_filter) -> None:
            self.topics = storage_filter.topics

        def seek(self, stamp: int) -> None:
            self.left = [one for one in content if one[2] >= stamp]

        def has_next(self) -> bool:
            self.left = [one for one in self.left if self.topics is None or one[0] in self.topics]
            return bool(self.left)

        def read_next(self):
            topic, data, stamp, _ = self.left.pop(0)
            if data == b"damaged":
                raise RuntimeError("chunk is damaged")
            return topic, data, stamp

    module = ModuleType("rosbag2_py")
    module.SequentialReader = SequentialReader
    module.StorageOptions = lambda uri, storage_id: SimpleNamespace(uri=uri, storage_id=storage_id)
    module.ConverterOptions = lambda *args: SimpleNamespace(args=args)
    module.StorageFilter = lambda topics: SimpleNamespace(topics=topics)
    module.content = content
    return module


@pytest.fixture
def no_packages(monkeypatch) -> Iterator[Callable[[], None]]:
    """Takes rosbags and mcap away when it is called: what writes bags needs them."""

    def take_away() -> None:
        for name in [name for name in sys.modules if name.partition(".")[0] in ("rosbags", "mcap")]:
            monkeypatch.delitem(sys.modules, name)
        for name in ("rosbags", "mcap"):
            monkeypatch.setitem(sys.modules, name, None)
        for name in ("mcap_file", "mcap_records"):
            monkeypatch.delitem(sys.modules, f"fisheye_ep_calib.storage.sources.{name}", raising=False)
        serialized._typestore.cache_clear()

    yield take_away
    serialized._typestore.cache_clear()


@pytest.mark.parametrize("kind", [IMAGE, COMPRESSED_IMAGE])
def test_an_mcap_is_read_by_ros(kind, tmp_path, monkeypatch, no_packages) -> None:
    pytest.importorskip("rclpy")
    pictures = images(5)
    recorded = messages(pictures, TOPIC, kind) + messages(pictures[:2], "/words", "text")
    recorded.append((TOPIC, recorded[4][1], kind, pictures[0]))  # a second one at the same time
    monkeypatch.setitem(sys.modules, "rosbag2_py", rosbag2_over(recorded))
    (tmp_path / "bag.mcap").write_bytes(b"\x89MCAP0\r\n")
    no_packages()
    with open_recording(tmp_path / "bag.mcap") as recording:
        assert recording.count(TOPIC) == 6
        for number, expected in ((4, pictures[4]), (0, pictures[0]), (5, pictures[0]), (2, pictures[2])):
            np.testing.assert_array_equal(recording.frame(TOPIC, number).image(), expected)


def test_an_sqlite_bag_needs_ros_alone(tmp_path, no_packages) -> None:
    pytest.importorskip("rclpy")
    pictures = images(3)
    path = write_db3(tmp_path / "bag.db3", messages(pictures, TOPIC))
    no_packages()
    with open_recording(path) as recording:
        for number, expected in enumerate(pictures):
            np.testing.assert_array_equal(recording.frame(TOPIC, number).image(), expected)


def test_without_any_reader_it_is_said(tmp_path, monkeypatch, no_packages) -> None:
    monkeypatch.setitem(sys.modules, "rosbag2_py", None)
    monkeypatch.delitem(sys.modules, "rosbag2_py")
    write_mcap(tmp_path / "bag.mcap", messages(images(1), TOPIC))
    no_packages()
    with pytest.raises(InputError, match="pip install mcap"):
        open_recording(tmp_path / "bag.mcap")


def test_damage_is_told_and_what_came_before_is_used(tmp_path, monkeypatch) -> None:
    recorded = messages(images(4), TOPIC)
    module = rosbag2_over(recorded)
    module.content[2] = (TOPIC, b"damaged", recorded[2][1], IMAGE)
    monkeypatch.setitem(sys.modules, "rosbag2_py", module)
    (tmp_path / "bag.mcap").write_bytes(b"1")
    source = RosBag.open(tmp_path / "bag.mcap")
    assert len(source.entries[TOPIC]) == 2 and "2 images before that" in source.problems[0]
    for entry in (Entry(recorded[2][1], (0,)), Entry(recorded[0][1] + 1, (0,)), Entry(2**62, (0,))):
        with pytest.raises(InputError):
            source.read(TOPIC, entry)
    (tmp_path / "broken.mcap").write_bytes(b"1")
    with pytest.raises(InputError, match="No storage could be initialized"):
        RosBag.open(tmp_path / "broken.mcap")


def test_damaged_messages_are_refused_by_ros_too(no_packages) -> None:
    pytest.importorskip("rclpy")
    whole = b"\0\1\0\0" + b"\0" * 8
    no_packages()
    with pytest.raises(InputError, match="damaged"):
        serialized.deserialize(whole[:5], IMAGE, "cdr")
    with pytest.raises(InputError, match="pip install rosbags"):
        serialized.deserialize(whole, IMAGE, "ros1")
