"""What every format of bags promises: images bit for bit, in order of time, and one clear line for what is none."""

from __future__ import annotations

import pickle
import shutil

import numpy as np
import pytest
from bag_writers import COMPRESSED_IMAGE, IMU, START_NS, WRITERS, images, messages

from fisheye_ep_calib.errors import InputError
from fisheye_ep_calib.storage.recording import open_recording
from fisheye_ep_calib.storage.sources.find import BAG_FORMATS

PICTURES = images(6)
TOPIC, OTHER = "/front/image_raw", "/rear/image_raw/compressed"


@pytest.fixture
def bag(bag_suffix, tmp_path):
    """Two cameras, one of them compressed, and something else, out of the order of time."""
    assert bag_suffix in WRITERS, "tests need a writer of this format: a line of WRITERS in test/support/bag_writers.py"
    recorded = messages(PICTURES, TOPIC) + messages(PICTURES[:4], OTHER, COMPRESSED_IMAGE)
    recorded += messages(PICTURES[:2], "/imu", IMU)
    return WRITERS[bag_suffix](tmp_path / f"recorded{bag_suffix}", recorded[::-1])


def contents(recording, topic) -> list[tuple[int, bytes]]:
    frames = [recording.frame(topic, index) for index in range(recording.count(topic))]
    return [(frame.stamp_ns, frame.image().tobytes()) for frame in frames]


def expected(count: int) -> list[tuple[int, bytes]]:
    return [(START_NS + i * 10**8, image.tobytes()) for i, image in enumerate(PICTURES[:count])]


def test_it_goes_by_its_own_suffix(bag_suffix) -> None:
    kind = BAG_FORMATS[bag_suffix]
    assert kind.suffix == bag_suffix and bag_suffix[0] == "." and bag_suffix == bag_suffix.lower()
    assert 4 <= len(kind.magic) <= 16, "a file is known by how it begins"
    starts = [other.magic for suffix, other in BAG_FORMATS.items() if suffix != bag_suffix]
    assert not any(kind.magic.startswith(other) or other.startswith(kind.magic) for other in starts)


def test_every_image_is_read_as_it_was_written(bag) -> None:
    with open_recording(bag) as recording:
        assert [(topic.name, topic.count) for topic in recording.image_topics()] == [(TOPIC, 6), (OTHER, 4)]
        assert recording.problems == () and "/imu" in recording.topics
        assert contents(recording, TOPIC) == expected(6) and contents(recording, OTHER) == expected(4)
        assert recording.frame(TOPIC, 2).taken_ns == START_NS + 2 * 10**8
        assert len(set(recording.identities(TOPIC))) == 6


def test_it_is_known_by_how_it_begins_and_in_a_folder(bag, tmp_path) -> None:
    strange = shutil.copy(bag, tmp_path / "strange.recording")
    folder = tmp_path / "folder"
    folder.mkdir()
    shutil.copy(bag, folder / bag.name)
    for path in (strange, folder):
        with open_recording(path) as recording:
            assert contents(recording, TOPIC) == expected(6)


def test_another_process_reads_the_same(bag) -> None:
    with open_recording(bag) as recording:
        first = contents(recording, TOPIC)
        with pickle.loads(pickle.dumps(recording)) as elsewhere:
            assert contents(elsewhere, TOPIC) == first


def test_the_same_bag_twice_is_read_once(bag, tmp_path) -> None:
    copy = shutil.copy(bag, tmp_path / f"copy{bag.suffix}")
    with open_recording([bag, copy]) as recording:
        assert recording.count(TOPIC) == 6 and any("used once" in problem for problem in recording.problems)


@pytest.mark.parametrize("keep", [0.0, 0.02, 0.3, 0.6, 0.9, 0.999])
def test_a_cut_file_says_so_and_gives_no_wrong_image(bag, bag_suffix, keep) -> None:
    content = bag.read_bytes()
    bag.write_bytes(content[: int(keep * len(content))])
    try:
        recording = open_recording(bag)
    except InputError as refused:
        assert bag.name in str(refused) and "\n" not in str(refused)
        return
    with recording:
        whole = expected(6)
        read = []
        for index in range(recording.count(TOPIC)):
            frame = recording.frame(TOPIC, index)
            try:
                read.append((frame.stamp_ns, frame.image().tobytes()))
            except InputError:
                continue
        assert set(read) <= set(whole)
        assert recording.problems or read == whole


@pytest.mark.parametrize("seed", range(3))
def test_noise_after_its_first_bytes_is_refused_in_one_line(bag_suffix, tmp_path, seed) -> None:
    path = tmp_path / f"noise{bag_suffix}"
    path.write_bytes(BAG_FORMATS[bag_suffix].magic + np.random.default_rng(seed).bytes(5000))
    with pytest.raises(InputError) as refused:
        with open_recording(path) as recording:
            assert not recording.image_topics()
            raise InputError(f"{path.name}: {recording.problems}")
    assert path.name in str(refused.value) and "\n" not in str(refused.value)
