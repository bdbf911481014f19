"""Small files that would unpack, or point, to far more than they hold: bounded, used as far as reached, and said so."""

from __future__ import annotations

import gzip
import io
import lzma
import resource
import sqlite3
import struct
import tarfile
import time

import cv2
import numpy as np
import pytest
import zstandard
from bag_writers import IMAGE, images, mcap_bytes, messages, write_db3, write_ros1
from mcap.opcode import Opcode

from fisheye_ep_calib.errors import InputError
from fisheye_ep_calib.storage.budget import Budget, Spent
from fisheye_ep_calib.storage.recording import open_recording

PICTURES = images(4, width=16, height=16)
RECORDED = messages(PICTURES)
MEBIBYTE = 2**20


@pytest.fixture(autouse=True)
def cheap():
    """Each of these costs a few seconds and some hundred megabytes at most."""
    before, began = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss, time.process_time()
    yield
    assert time.process_time() - began < 15
    assert resource.getrusage(resource.RUSAGE_SELF).ru_maxrss - before < 1_000_000  # kB


def told(path) -> tuple[int, str]:
    """Images listed, and what is said."""
    try:
        with open_recording(path) as recording:
            return sum(topic.count for topic in recording.image_topics()), "; ".join(recording.problems)
    except InputError as error:
        return 0, str(error)


def begun_mcap() -> bytes:
    """As a recorder leaves it that still writes."""
    whole = mcap_bytes(RECORDED)
    return whole[: whole.rindex(struct.pack("<BQ", Opcode.DATA_END, 4))]


def record(opcode: int, content: bytes) -> bytes:
    return struct.pack("<BQ", opcode, len(content)) + content


def indexed_mcap(entries: int, chunk_indexes: int, same_start: bool) -> bytes:
    """One image, and an index of ``entries`` that is pointed at many times."""
    schema = record(Opcode.SCHEMA, struct.pack("<HI", 1, len(IMAGE)) + IMAGE.encode() + struct.pack("<II", 0, 0))
    channel = struct.pack("<HHI", 1, 1, 2) + b"/a" + struct.pack("<I", 3) + b"cdr" + struct.pack("<I", 0)
    described = schema + record(Opcode.CHANNEL, channel)
    data = record(Opcode.MESSAGE, struct.pack("<HIQQ", 1, 0, 5, 5) + bytes(64))
    begin = b"\x89MCAP0\r\n" + record(Opcode.HEADER, struct.pack("<II", 0, 0)) + described
    chunk = record(Opcode.CHUNK, struct.pack("<QQQIIQ", 0, 9, len(data), 0, 0, len(data)) + data)
    places = b"".join(struct.pack("<QQ", stamp, 0) for stamp in range(entries))
    index_at = len(begin) + len(chunk)
    index = record(Opcode.MESSAGE_INDEX, struct.pack("<HI", 1, len(places)) + places)
    body = begin + chunk + index + record(Opcode.DATA_END, bytes(4))
    summary = described
    for number in range(chunk_indexes):
        start = len(begin) + (0 if same_start else number)
        about = struct.pack("<QQQQ", 0, 9, start, len(chunk)) + struct.pack("<IHQ", 10, 1, index_at)
        summary += record(Opcode.CHUNK_INDEX, about + struct.pack("<Q", len(index)) + struct.pack("<IQQ", 0, 64, 64))
    footer = record(Opcode.FOOTER, struct.pack("<QQI", len(body), 0, 0))
    return body + summary + footer + b"\x89MCAP0\r\n"


@pytest.mark.parametrize("same_start", [True, False])
def test_an_index_that_is_pointed_at_many_times(tmp_path, same_start) -> None:
    (tmp_path / "a.mcap").write_bytes(indexed_mcap(20_000, 3_000, same_start))
    count, _ = told(tmp_path / "a.mcap")
    assert count <= 400_000
    (tmp_path / "one.mcap").write_bytes(indexed_mcap(3, 1, True))
    assert told(tmp_path / "one.mcap")[0] == 3  # the same file, as an honest one is built


@pytest.mark.parametrize("pack", ["zstd", "lz4"])
def test_chunks_that_unpack_to_nothing_but_bytes(tmp_path, pack) -> None:
    import lz4.frame

    whole = begun_mcap()
    filling = record(0x80, bytes(200 * MEBIBYTE))
    packed = zstandard.compress(filling) if pack == "zstd" else lz4.frame.compress(filling)
    head = struct.pack("<QQQII", 0, 9, len(filling), 0, len(pack)) + pack.encode() + struct.pack("<Q", len(packed))
    (tmp_path / "a.mcap").write_bytes(whole + record(Opcode.CHUNK, head + packed) * 200)
    count, said = told(tmp_path / "a.mcap")
    assert count == len(PICTURES) and ("used" in said or "lost" in said)


def test_whole_files_and_archives_that_unpack_to_more_than_recordings_do(tmp_path) -> None:
    frames = [zstandard.compress(bytes(64 * MEBIBYTE))] * 200
    (tmp_path / "a.mcap.zstd").write_bytes(zstandard.compress(begun_mcap()) + b"".join(frames))
    count, said = told(tmp_path / "a.mcap.zstd")
    assert count == len(PICTURES) and "unpacks to far more" in said

    def archive(packer, name: str) -> None:
        tar = io.BytesIO()
        with tarfile.open(fileobj=tar, mode="w") as writer:
            for number, picture in enumerate(PICTURES):
                content = cv2.imencode(".png", picture)[1].tobytes()
                member = tarfile.TarInfo(f"{number}.png")
                member.size = len(content)
                writer.addfile(member, io.BytesIO(content))
            length = tar.tell()
        head = tarfile.TarInfo("large.bin")
        head.size = 2**33
        begun = tar.getvalue()[:length]
        (tmp_path / name).write_bytes(packer(begun + head.tobuf()) + packer(bytes(64 * MEBIBYTE)) * 40)

    archive(gzip.compress, "a.tar.gz")
    archive(lambda content: lzma.compress(content, preset=1), "b.tar.xz")
    for name in ("a.tar.gz", "b.tar.xz"):
        count, said = told(tmp_path / name)
        assert count == len(PICTURES) and "unpacks to far more" in said, (name, said)


def test_an_xz_file_that_asks_for_more_memory_than_it_may(tmp_path, monkeypatch) -> None:
    monkeypatch.setattr("fisheye_ep_calib.storage.compression._XZ_MEMORY", 2**20)
    (tmp_path / "a.tar.xz").write_bytes(lzma.compress(bytes(1024), preset=6))
    assert "Memory usage limit" in told(tmp_path / "a.tar.xz")[1]


def test_headers_of_headers_without_end(tmp_path) -> None:
    long = tarfile.TarInfo("a")
    long.type, long.size = tarfile.GNUTYPE_LONGNAME, 10
    (tmp_path / "a.tar").write_bytes((long.tobuf() + b"n" * 512) * 5000)
    assert "not a tar archive" in told(tmp_path / "a.tar")[1]


@pytest.mark.parametrize(
    "change",
    [
        "ALTER TABLE messages RENAME TO kept; CREATE VIEW messages AS WITH RECURSIVE c(x) AS (SELECT 1 UNION ALL"
        " SELECT x + 1 FROM c) SELECT x AS id, 1 AS topic_id, x AS timestamp, zeroblob(9) AS data FROM c",
        "ALTER TABLE topics RENAME TO kept; CREATE VIEW topics AS SELECT * FROM kept, kept AS b",
        "ALTER TABLE messages ADD COLUMN more GENERATED ALWAYS AS (hex(zeroblob(300000000)))",
        "ALTER TABLE messages RENAME TO kept; CREATE VIRTUAL TABLE messages USING fts5(id, topic_id, timestamp, data)",
        "ALTER TABLE messages RENAME TO kept; CREATE TABLE messages(id, topic_id, timestamp, data)",
        "DROP TABLE messages",
    ],
)
def test_databases_that_are_programs(tmp_path, change) -> None:
    write_db3(tmp_path / "a.db3", RECORDED)
    assert told(tmp_path / "a.db3") == (len(PICTURES), "")
    connection = sqlite3.connect(tmp_path / "a.db3")
    connection.executescript(change)
    connection.close()
    count, said = told(tmp_path / "a.db3")
    assert count == 0 and "is not a rosbag2 database" in said


def test_pages_of_a_database_that_lead_back_to_one_another(tmp_path) -> None:
    """Every pointer of the root of ``messages`` is bent to the first of them: rows come again and again."""
    path = write_db3(tmp_path / "a.db3", messages(images(400, width=60, height=60)))
    content = bytearray(path.read_bytes())
    (size,) = struct.unpack_from(">H", content, 16)
    bent = 0
    for page in range(size, len(content), size):
        if content[page] == 5:  # an interior page of a table: pointers to its children, and its last child
            (count,) = struct.unpack_from(">H", content, page + 3)
            cells = [page + struct.unpack_from(">H", content, page + 12 + 2 * n)[0] for n in range(count)]
            for cell in cells[1:] + [page + 8]:
                content[cell : cell + 4] = content[cells[0] : cells[0] + 4]
                bent += 1
    assert bent
    path.write_bytes(content)
    count, said = told(path)
    assert 0 < count <= 400 and "damaged" in said


def test_a_bag_whose_index_names_one_chunk_many_times(tmp_path) -> None:
    path = write_ros1(tmp_path / "a.bag", RECORDED, chunk_bytes=10**6)
    content = bytearray(path.read_bytes())
    at = content.find(b"op=\x06") - 8
    while content[at : at + 4] != b"\x04\0\0\0":
        at += 1
    head_at = at - 4
    info = bytes(content[head_at:])  # the only chunk info is the last record
    times = 20_000
    content += info * (times - 1)
    place = content.find(b"chunk_count=") + len(b"chunk_count=")
    content[place : place + 4] = struct.pack("<I", times)
    path.write_bytes(content)
    began = time.process_time()
    count, _ = told(path)
    assert count == len(PICTURES) and time.process_time() - began < 5


def test_seconds_without_an_image_are_counted(monkeypatch) -> None:
    now = [0.0]
    monkeypatch.setattr("fisheye_ep_calib.storage.budget.time.process_time", lambda: now[0])
    budget = Budget()
    budget.grow(1000)
    for _ in range(5):
        now[0] += 6
        budget.enter()
        budget.take(10)
    now[0] += 10
    with pytest.raises(Spent, match="no further image"):
        budget.take(10)


def test_a_packed_bag_of_a_few_bytes_holds_no_image_of_forty_megapixels(tmp_path):
    picture = np.zeros((5000, 8000), np.uint8)
    (tmp_path / "a.mcap.zstd").write_bytes(zstandard.compress(mcap_bytes(messages([picture]))))
    with open_recording(tmp_path / "a.mcap.zstd") as recording:
        (topic,) = recording.image_topics()
        with pytest.raises(InputError, match="declares 8000×5000 pixels, but holds [0-9]+ bytes only"):
            recording.frame(topic.name, 0).image()
