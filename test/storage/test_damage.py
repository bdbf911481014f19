"""Damaged recordings: what is readable is used, what is lost is said, and nothing else ever happens."""

import os
import struct
import time
import tracemalloc

import numpy as np
import pytest
from bag_writers import images, mcap_bytes, messages, write_ros1, write_rosbag2
from damages import DAMAGES
from mcap.writer import CompressionType, IndexType

from fisheye_ep_calib.errors import InputError
from fisheye_ep_calib.storage.recording import open_recording

PICTURES = images()
TOPIC = "/camera/image_raw"
RECORDED = sorted(messages(PICTURES, TOPIC) + messages(PICTURES, "/chatter", "other"), key=lambda m: m[1])


def db3_bytes(folder) -> bytes:
    (path,) = write_rosbag2(folder / "bag", RECORDED).glob("*.db3")
    return path.read_bytes()


FORMATS = {
    "mcap": (".mcap", lambda p: mcap_bytes(RECORDED)),
    "mcap, zstd": (".mcap", lambda p: mcap_bytes(RECORDED, compression=CompressionType.ZSTD)),
    "mcap, lz4, no index": (
        ".mcap",
        lambda p: mcap_bytes(RECORDED, compression=CompressionType.LZ4, index_types=IndexType.NONE),
    ),
    "mcap, no chunks": (".mcap", lambda p: mcap_bytes(RECORDED, use_chunking=False)),
    "mcap, no checksums": (".mcap", lambda p: mcap_bytes(RECORDED, enable_crcs=False)),
    "db3": (".db3", db3_bytes),
    "bag": (".bag", lambda p: write_ros1(p / "a.bag", RECORDED).read_bytes()),
    "bag, bz2": (".bag", lambda p: write_ros1(p / "a.bag", RECORDED, "bz2").read_bytes()),
    "bag, lz4": (".bag", lambda p: write_ros1(p / "a.bag", RECORDED, "lz4").read_bytes()),
}


def survive(path) -> None:
    """Use a damaged file as a calibration would: every image or an InputError, quickly, and no loss in silence."""
    started = time.monotonic()
    try:
        with open_recording(path) as recording:
            readable = 0
            refused = 0
            for frame in recording.frames():
                try:
                    readable += frame.image().dtype == np.uint8
                except InputError as error:
                    assert "\n" not in str(error)
                    refused += 1
            lost = len(PICTURES) - readable - refused
            assert lost <= 0 or recording.problems, f"{lost} images were lost in silence"
    except InputError as error:
        assert "\n" not in str(error)
    assert time.monotonic() - started < 10


def damage_many(tmp_path, name, trials, seed):
    suffix, make = FORMATS[name]
    content = make(tmp_path)
    generator = np.random.default_rng(seed)
    path = tmp_path / f"damaged{suffix}"
    for trial in range(trials):
        path.write_bytes(DAMAGES[trial % len(DAMAGES)](content, generator))
        survive(path)


@pytest.mark.parametrize("name", FORMATS)
def test_damaged_files_are_salvaged_or_refused(tmp_path, name):
    damage_many(tmp_path, name, trials=60, seed=1)


@pytest.mark.slow
@pytest.mark.parametrize("seed", range(2, 12))
@pytest.mark.parametrize("name", FORMATS)
def test_thousands_of_damaged_files_are_salvaged_or_refused(tmp_path, name, seed):
    damage_many(tmp_path, name, trials=200, seed=seed)


@pytest.mark.parametrize("name", FORMATS)
def test_sixty_percent_of_a_file_give_most_of_sixty_percent_of_its_images(tmp_path, name):
    suffix, make = FORMATS[name]
    content = make(tmp_path)
    path = tmp_path / f"part{suffix}"
    path.write_bytes(content[: int(0.6 * len(content))])
    with open_recording(path) as recording:
        assert any("cut short" in problem for problem in recording.problems)
        readable = 0
        for frame, picture in zip(recording.frames(), PICTURES, strict=False):
            try:
                np.testing.assert_array_equal(frame.image(), picture)
                readable += 1
            except InputError:
                pass
    assert readable >= 4
    with pytest.raises(InputError, match="cut short"):
        open_recording(path, strict=True)


def test_a_damaged_part_of_a_split_recording_does_not_cost_the_others(tmp_path):
    folder = tmp_path / "bag"
    folder.mkdir()
    content = [mcap_bytes(RECORDED[8 * part : 8 * part + 8]) for part in range(3)]
    for part in (0, 2):
        (folder / f"bag_{part}.mcap").write_bytes(content[part])
    (folder / "bag_1.mcap").write_bytes(b"broken" + content[1])
    listed = [*(f"bag_{part}.mcap" for part in range(4)), "x" * 5000]  # no file can have the last one's name
    (folder / "metadata.yaml").write_text(f"rosbag2_bagfile_information: {{relative_file_paths: {listed}}}")
    with open_recording(folder) as recording:
        assert recording.count(TOPIC) == 8
        said = "\n".join(recording.problems)
    assert "bag_3.mcap, xxx" in said and "xxx listed in metadata.yaml but not there" in said
    assert max(map(len, recording.problems)) < 500
    assert "bag_1.mcap is not an MCAP file" in said
    (folder / "metadata.yaml").write_text("rosbag2_bagfile_information: [")
    with open_recording(folder) as recording:
        assert recording.count(TOPIC) == 8
        assert any("whether files of the bag are missing cannot be told" in problem for problem in recording.problems)


def test_a_flipped_pixel_of_a_checked_chunk_is_noticed(tmp_path):
    content = bytearray(mcap_bytes(RECORDED))
    row = PICTURES[5].tobytes()
    position = bytes(content).find(row)
    content[position + 100] ^= 4
    path = tmp_path / "a.mcap"
    path.write_bytes(content)
    with open_recording(path) as recording:
        with pytest.raises(InputError, match="checksum"):
            recording.frame(TOPIC, 5).image()
        np.testing.assert_array_equal(recording.frame(TOPIC, 11).image(), PICTURES[11])


@pytest.mark.parametrize("compression", [CompressionType.ZSTD, CompressionType.LZ4])
def test_a_chunk_that_holds_more_than_it_declares_is_refused(tmp_path, compression):
    blank = [np.zeros((300, 300), np.uint8)] * 4  # compresses well, as a decompression bomb does
    content = bytearray(mcap_bytes(messages(blank), compression=compression, chunk_size=10**7, enable_crcs=False))
    chunk = content.find(b"\x06", 8)
    while int.from_bytes(content[chunk + 25 : chunk + 33], "little") not in range(360_000, 370_000):
        chunk = content.find(b"\x06", chunk + 1)
    content[chunk + 25 : chunk + 33] = (1000).to_bytes(8, "little")
    path = tmp_path / "a.mcap"
    path.write_bytes(content)
    with open_recording(path) as recording, pytest.raises(InputError, match="more than it declares"):
        recording.frame(TOPIC, 0).image()


def test_a_garbage_record_that_looks_like_the_end_is_told(tmp_path):
    content = bytearray(mcap_bytes(messages(PICTURES, TOPIC), use_chunking=False))
    found = [position for position, opcode, _ in mcap_records(content) if opcode == 5]
    content[found[6]] = 15
    (tmp_path / "a.mcap").write_bytes(content)
    with open_recording(tmp_path / "a.mcap") as recording:
        assert recording.count(TOPIC) == 6 and "the 6 images" in recording.problems[0]


def mcap_records(content):
    position = 8
    while position < len(content) - 8:
        opcode, length = struct.unpack_from("<BQ", content, position)
        yield position, opcode, length
        position += 9 + length


@pytest.mark.parametrize("compression", ["bz2", "lz4"])
def test_a_packed_chunk_that_is_too_short_is_told(tmp_path, compression):
    bag = write_ros1(tmp_path / "a.bag", RECORDED, compression)
    content = bytearray(bag.read_bytes())
    position = 13
    while True:
        data = position + 4 + int.from_bytes(content[position : position + 4], "little")
        length = int.from_bytes(content[data : data + 4], "little")
        if b"op=\x05" in content[position:data]:
            break
        position = data + 4 + length
    content[data : data + 4] = (length - 300).to_bytes(4, "little")
    bag.write_bytes(content)
    with open_recording(bag) as recording:
        assert recording.count(TOPIC) < len(PICTURES) and recording.problems


def test_an_image_file_that_no_image_needs_is_not_read(tmp_path):
    for name in ("a.jpg", "b.jpg"):
        (tmp_path / name).write_bytes(b"\xff\xd8\xff\xe0" + bytes(100))
        os.truncate(tmp_path / name, 400_000_000)  # takes no disk
    with open_recording(tmp_path) as recording:
        tracemalloc.start()
        with pytest.raises(InputError, match=r"a\.jpg: too large for a"):
            recording.frame(recording.image_topics()[0].name, 0).image()
        most = tracemalloc.get_traced_memory()[1]
        tracemalloc.stop()
    assert most < 3e8
