"""The same images come out of a recording, whatever it is stored in."""

import os
import pickle
import shutil
import sqlite3
from pathlib import Path

import numpy as np
import pytest
from bag_writers import (
    COMPRESSED_IMAGE,
    IMAGE,
    IMU,
    START_NS,
    images,
    mcap_bytes,
    messages,
    serialize,
    write_folder,
    write_mcap,
    write_ros1,
    write_rosbag2,
)
from mcap.writer import CompressionType, IndexType
from mcap.writer import Writer as McapWriter

from fisheye_ep_calib.errors import InputError
from fisheye_ep_calib.storage.compression import ZSTD_MAGIC
from fisheye_ep_calib.storage.recording import choose_topics, open_recording
from fisheye_ep_calib.storage.sources.find import _matches

PICTURES = images()
RECORDED = messages(PICTURES)


def test_a_bag_that_is_still_recorded_is_found_in_its_folder(tmp_path):
    write_ros1(tmp_path / "x_0.bag", RECORDED[:6]).rename(tmp_path / "x_0.BAG")
    write_ros1(tmp_path / "x_1.bag", RECORDED[6:]).rename(tmp_path / "x_1.bag.active")
    with open_recording(tmp_path) as recording:
        assert recording.count("/camera/image_raw") == len(PICTURES)


def test_images_beside_a_metadata_file_of_something_else(tmp_path):
    write_folder(tmp_path / "front", PICTURES)
    (tmp_path / "front" / "metadata.yaml").write_text("lens: fisheye\n")
    with open_recording(tmp_path / "front", strict=True) as recording:
        assert recording.count("front") == len(PICTURES)


def test_messages_beside_chunks_are_found_without_statistics(tmp_path):
    """A writer may leave a message outside of chunks; an index of chunks says nothing of it."""
    with open(tmp_path / "a.mcap", "wb") as file:
        writer = McapWriter(file, use_statistics=False)
        writer.start(profile="ros2", library="test")
        channel = writer.register_channel("/camera/image_raw", "cdr", writer.register_schema(IMAGE, "ros2msg", b"#"))
        for number, (_, stamp, kind, image) in enumerate(RECORDED):
            if number == 6:
                writer._Writer__finalize_chunk()
                writer._Writer__chunk_builder = None
            writer.add_message(channel, stamp, serialize(kind, image, stamp), stamp)
        writer.finish()
    with open_recording(tmp_path / "a.mcap", strict=True) as recording:
        assert recording.count("/camera/image_raw") == len(PICTURES)


def split_rosbag2(path, storage):
    """As rosbag2 splits a recording: several files in one folder."""
    whole = []
    for part in range(3):
        bag = write_rosbag2(path.parent / f"part{part}", RECORDED[part * 4 : part * 4 + 4], storage)
        whole += [file for file in bag.iterdir() if file.suffix != ".yaml"]
    path.mkdir()
    names = [f"{path.name}_{number}{file.suffix}" for number, file in enumerate(whole)]
    for name, file in zip(names, whole, strict=True):
        shutil.move(file, path / name)
    listed = ", ".join(names)
    (path / "metadata.yaml").write_text(f"rosbag2_bagfile_information:\n  relative_file_paths: [{listed}]\n")
    return path


def only_file(folder, suffix):
    """The storage file alone, away from its metadata.yaml."""
    (file,) = folder.glob(f"*{suffix}")
    alone = folder.parent / f"alone{suffix}"
    shutil.move(file, alone)
    return alone


FORMATS = {
    "rosbag2 sqlite3": lambda p: write_rosbag2(p / "bag", RECORDED),
    "rosbag2 mcap": lambda p: write_rosbag2(p / "bag", RECORDED, "mcap"),
    "rosbag2 sqlite3, messages compressed": lambda p: write_rosbag2(p / "bag", RECORDED, compression="message"),
    "rosbag2 mcap, messages compressed": lambda p: write_rosbag2(p / "bag", RECORDED, "mcap", "message"),
    "rosbag2 sqlite3, file compressed": lambda p: write_rosbag2(p / "bag", RECORDED, compression="file"),
    "rosbag2 sqlite3, split": lambda p: split_rosbag2(p / "bag", "sqlite3"),
    "rosbag2 mcap, split": lambda p: split_rosbag2(p / "bag", "mcap"),
    "db3": lambda p: only_file(write_rosbag2(p / "bag", RECORDED), ".db3"),
    "mcap": lambda p: only_file(write_rosbag2(p / "bag", RECORDED, "mcap"), ".mcap"),
    "mcap, zstd chunks": lambda p: write_mcap(p / "a.mcap", RECORDED, compression=CompressionType.ZSTD),
    "mcap, lz4 chunks": lambda p: write_mcap(p / "a.mcap", RECORDED, compression=CompressionType.LZ4),
    "mcap, profile ros1": lambda p: write_mcap(p / "a.mcap", RECORDED, profile="ros1"),
    "mcap, no profile": lambda p: write_mcap(p / "a.mcap", RECORDED, profile=""),
    "mcap, no chunks": lambda p: write_mcap(p / "a.mcap", RECORDED, use_chunking=False),
    "mcap, one chunk": lambda p: write_mcap(p / "a.mcap", RECORDED, chunk_size=10**8),
    "mcap, no index": lambda p: write_mcap(p / "a.mcap", RECORDED, index_types=IndexType.NONE),
    "mcap, zstd, no index": lambda p: write_mcap(
        p / "a.mcap", RECORDED, compression=CompressionType.ZSTD, index_types=IndexType.NONE
    ),
    "mcap, no statistics, no checksums": lambda p: write_mcap(
        p / "a.mcap", RECORDED, use_statistics=False, enable_crcs=False
    ),
    "ROS 1 bag": lambda p: write_ros1(p / "a.bag", RECORDED),
    "ROS 1 bag, bz2": lambda p: write_ros1(p / "a.bag", RECORDED, "bz2"),
    "ROS 1 bag, lz4": lambda p: write_ros1(p / "a.bag", RECORDED, "lz4"),
}


@pytest.mark.parametrize("name", FORMATS)
def test_every_format_gives_the_same_images(name, tmp_path):
    with open_recording(FORMATS[name](tmp_path)) as recording:
        assert recording.problems == ()
        (topic,) = recording.image_topics()
        assert (topic.name, topic.type, topic.count) == ("/camera/image_raw", "sensor_msgs/msg/Image", 12)
        frames = list(recording.frames())
        assert [frame.stamp_ns for frame in frames] == [stamp for _, stamp, _, _ in RECORDED]
        for frame, picture in zip(frames, PICTURES, strict=True):
            np.testing.assert_array_equal(frame.image(), picture)


@pytest.mark.parametrize("name", ["db3", "mcap, zstd chunks", "ROS 1 bag, lz4", "rosbag2 sqlite3, file compressed"])
def test_frames_are_read_in_any_order_by_another_process(name, tmp_path):
    with open_recording(FORMATS[name](tmp_path)) as recording:
        recording.frame("/camera/image_raw", 0).image()
        copy = pickle.loads(pickle.dumps(recording))
        for index in (7, 2, 11, 0):
            np.testing.assert_array_equal(copy.frame("/camera/image_raw", index).image(), PICTURES[index])
        copy.close()


@pytest.mark.parametrize("suffix", [".png", ".bmp", ".tif"])
def test_a_folder_of_images_in_natural_order(tmp_path, suffix):
    folder = write_folder(tmp_path / "front", PICTURES, suffix)
    (folder / "notes.txt").write_text("not an image")
    for named in (folder, f"{folder}/*{suffix}", [folder / f"frame{i}{suffix}" for i in reversed(range(12))]):
        with open_recording(named) as recording:
            (topic,) = recording.image_topics()
            assert (topic.name, topic.count) == ("front", 12)
            frames = list(recording.frames(["front"]))
            assert frames[2].name == f"frame2{suffix}" and frames[10].name == f"frame10{suffix}"
            for frame, picture in zip(frames, PICTURES, strict=True):
                np.testing.assert_array_equal(frame.image(), picture)


def test_a_single_image_and_a_folder_for_each_camera(tmp_path):
    write_folder(tmp_path / "rig" / "left", PICTURES[:2])
    write_folder(tmp_path / "rig" / "right", PICTURES[2:5])
    with open_recording(tmp_path / "rig") as recording:
        assert [(topic.name, topic.count) for topic in recording.image_topics()] == [
            ("left", 2),
            ("right", 3),
        ]
    with open_recording(tmp_path / "rig" / "left" / "frame1.png") as recording:
        np.testing.assert_array_equal(recording.frame("left", 0).image(), PICTURES[1])


def test_several_cameras_interleave_in_time(tmp_path):
    left = messages(PICTURES[:6], "/left/image_raw")
    right = messages(PICTURES[6:], "/right/image_raw/compressed", COMPRESSED_IMAGE, START_NS + 10**6)
    other = messages(PICTURES, "/chatter", IMU)
    path = write_rosbag2(tmp_path / "bag", sorted(left + right + other, key=lambda m: m[1]))
    with open_recording(path) as recording:
        assert [frame.topic for frame in recording.frames()][:4] == ["/left/image_raw", right[0][0]] * 2
        np.testing.assert_array_equal(recording.frame(right[0][0], 2).image(), PICTURES[8])
        assert recording.topics["/chatter"] == "std_msgs/msg/String"
        with pytest.raises(InputError, match=r"2 image topics: /left/image_raw \(6 × sensor_msgs/msg/Image\)"):
            choose_topics(recording)
        assert choose_topics(recording, ["/left/image_raw"]) == ("/left/image_raw",)
        with pytest.raises(InputError, match="/chatter is of type std_msgs/msg/String"):
            choose_topics(recording, ["/chatter"])
        with pytest.raises(InputError, match="no topic /lefft"):
            choose_topics(recording, ["/lefft"])


def test_several_bags_of_different_formats_are_one_recording(tmp_path):
    parts = [
        write_ros1(tmp_path / "b.bag", RECORDED[6:]),
        write_mcap(tmp_path / "a.mcap", RECORDED[:3]),
        write_rosbag2(tmp_path / "c", RECORDED[3:6]),
    ]
    with open_recording(parts) as recording:
        assert recording.count("/camera/image_raw") == 12
        for frame, picture in zip(recording.frames(), PICTURES, strict=True):
            np.testing.assert_array_equal(frame.image(), picture)


def test_messages_stored_out_of_order_come_in_order(tmp_path):
    shuffled = [RECORDED[i] for i in np.random.default_rng(0).permutation(12)]
    for path in (
        write_mcap(tmp_path / "a.mcap", shuffled),
        write_rosbag2(tmp_path / "b", shuffled),
        write_ros1(tmp_path / "c.bag", shuffled),
    ):
        with open_recording(path) as recording:
            for frame, picture in zip(recording.frames(), PICTURES, strict=True):
                np.testing.assert_array_equal(frame.image(), picture)


def test_a_file_is_known_by_its_content(tmp_path):
    path = write_mcap(tmp_path / "a.mcap", RECORDED).rename(tmp_path / "recording")
    with open_recording(path) as recording:
        assert recording.count("/camera/image_raw") == 12


def test_what_was_decompressed_is_removed(tmp_path, monkeypatch):
    scratch = tmp_path / "scratch"
    scratch.mkdir()
    monkeypatch.setattr("tempfile.tempdir", str(scratch))
    with open_recording(FORMATS["rosbag2 sqlite3, file compressed"](tmp_path)) as recording:
        recording.frame("/camera/image_raw", 0).image()
        assert len(list(scratch.rglob("*.db3"))) == 1
    assert list(scratch.iterdir()) == []


def test_reading_leaves_nothing_beside_the_users_file(tmp_path):
    path = FORMATS["db3"](tmp_path)
    before = sorted(tmp_path.iterdir())
    with open_recording(path) as recording:
        list(frame.image() for frame in recording.frames())
    assert sorted(tmp_path.iterdir()) == before


def test_a_database_whose_journal_is_pending_is_read_with_it(tmp_path):
    path = FORMATS["db3"](tmp_path)
    writer = sqlite3.connect(path)
    writer.execute("PRAGMA journal_mode = WAL")
    writer.execute("PRAGMA wal_autocheckpoint = 0")
    writer.execute("DELETE FROM messages WHERE id = 1")
    writer.commit()
    with open_recording(path) as recording:
        assert recording.count("/camera/image_raw") == 11
    writer.close()


def empty_database(path):
    connection = sqlite3.connect(path)
    connection.execute("CREATE TABLE other (id INTEGER)")
    connection.commit()
    connection.close()
    return path


@pytest.mark.parametrize(
    "make, said",
    [
        (lambda p: p / "none.mcap", "none.mcap does not exist"),
        (lambda p: p / "none_*.png", "does not exist"),
        (lambda p: p, "holds neither a bag"),
        (lambda p: [], "no recording is named"),
        (lambda p: write_bytes(p / "a.mcap", b""), "is empty"),
        (lambda p: write_bytes(p / "a.mcap", b"x" * 100), "not an MCAP file"),
        (lambda p: write_bytes(p / "a.bag", b"x" * 100), "not a ROS 1 bag"),
        (lambda p: write_bytes(p / "a.db3", b"x" * 100), "not a rosbag2 database"),
        (lambda p: write_bytes(p / "a.txt", b"x" * 100), "neither a bag"),
        (lambda p: write_bytes(p / "a.mcap", ZSTD_MAGIC + b"x" * 100), "damaged"),
        (lambda p: write_bytes(p / "metadata.yaml", b"a: b").parent, "holds no bag file"),
        (lambda p: empty_database(p / "a.db3"), "no such table: topics"),
        (lambda p: write_mcap(p / "a.mcap", []), "holds no messages"),
        (lambda p: write_rosbag2(p / "bag", []), "holds no topics"),
        (lambda p: write_ros1(p / "a.bag", []), "holds no messages"),
        (
            lambda p: write_rosbag2(p / "bag", messages(PICTURES, "/chatter", IMU)),
            r"holds no images; its topics: /chatter \(std_msgs/msg/String\)",
        ),
        (
            lambda p: write_ros1(p / "a.bag", messages(PICTURES, "/chatter", IMU)),
            r"its topics: /chatter \(std_msgs/msg/String\)",
        ),
    ],
)
def test_what_cannot_be_used_gets_one_line(tmp_path, make, said):
    with pytest.raises(InputError, match=said) as error:
        open_recording(make(tmp_path))
    assert "\n" not in str(error.value)


def write_bytes(path, content):
    path.write_bytes(content)
    return path


def test_one_damaged_image_does_not_cost_the_others(tmp_path):
    folder = write_folder(tmp_path / "front", PICTURES)
    (folder / "frame5.png").write_bytes(b"\x89PNG\r\n\x1a\n broken")
    with open_recording(folder) as recording:
        failed = [frame.name for frame in recording.frames() if not readable(frame)]
    assert failed == ["frame5.png"]


def readable(frame) -> bool:
    try:
        frame.image()
    except InputError:
        return False
    return True


def test_an_unfinished_recording_is_read_as_far_as_it_goes(tmp_path):
    path = write_bytes(tmp_path / "a.mcap", mcap_bytes(RECORDED, finish=False))
    with open_recording(path) as recording:
        count = recording.count("/camera/image_raw")
        assert 8 <= count <= 12
        assert "cut short" in recording.problems[0]
        for frame, picture in zip(recording.frames(), PICTURES, strict=False):
            np.testing.assert_array_equal(frame.image(), picture)
    with pytest.raises(InputError, match="unfinished"):
        open_recording(path, strict=True)


def test_a_recording_of_many_parts_keeps_few_files_open(tmp_path):
    parts = [write_mcap(tmp_path / f"{number:03d}.mcap", [RECORDED[number % 12]]) for number in range(40)]
    before = len(os.listdir("/proc/self/fd")) if os.path.isdir("/proc/self/fd") else None
    with open_recording(parts) as recording:
        for frame in recording.frames():
            frame.image()
        if before is not None:
            assert len(os.listdir("/proc/self/fd")) - before <= 10


def test_a_pattern_ends_where_links_do_not(tmp_path, monkeypatch):
    (tmp_path / "a" / "b").mkdir(parents=True)
    for name in ("first", "second"):
        (tmp_path / "a" / name).symlink_to(tmp_path / "a")
    (tmp_path / "elsewhere").symlink_to(tmp_path / "a" / "b")
    for place in ("top.png", "a/one.png", "a/b/two.png", "a/b/.hidden.png"):
        (tmp_path / place).write_bytes(b"")
    monkeypatch.chdir(tmp_path)
    images = {"top.png", "one.png", "two.png"}
    for pattern in ("**/*.png", f"{tmp_path}/**/*.png", "**"):
        found = [Path(match) for match in _matches(pattern)]
        assert len(found) < 10 and {path.name for path in found if path.is_file()} == images, pattern
    assert {Path(match) for match in _matches("a/**/b/*.png")} == {Path("a/b/two.png")}
    assert not _matches("**/*.mcap") and [Path(match) for match in _matches("*.png")] == [Path("top.png")]
