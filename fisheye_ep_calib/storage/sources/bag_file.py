"""ROS 1 bags (format 2.0), whole, unindexed or cut short. The format: https://wiki.ros.org/Bags/Format/2.0."""

from __future__ import annotations

import struct
from io import BytesIO
from pathlib import Path
from typing import Any, BinaryIO, NamedTuple

from fisheye_ep_calib.errors import InputError
from fisheye_ep_calib.storage.compression import decompress
from fisheye_ep_calib.storage.sources.base import MAX_MESSAGE_BYTES, BagSource, Entry, topic_name

MAGIC = b"#ROSBAG V2.0\n"
MAX_HEADER_BYTES = 2**20
MAX_CHUNK_BYTES = 2**28
INDEX_ENTRY_BYTES = 12
LAST_POSITION = 2**62  # beyond any file, within what seek() takes

MESSAGE, BAG_HEADER, INDEX, CHUNK, CHUNK_INFO, CONNECTION = 2, 3, 4, 5, 6, 7


class Damaged(Exception):
    """The record at this position makes no sense, or is not whole."""


class Record(NamedTuple):
    """A record's header fields, and where its data lies."""

    fields: dict[bytes, bytes]
    data: int
    length: int

    @property
    def end(self) -> int:
        return self.data + self.length

    @property
    def kind(self) -> int:
        return self.number("op", "<B")

    def number(self, name: str, layout: str = "<I") -> int:
        try:
            (number,) = struct.unpack(layout, self.fields[name.encode()])
            return int(number)
        except (KeyError, struct.error):
            raise Damaged from None

    def text(self, name: str) -> str:
        try:
            return self.fields[name.encode()].decode("utf-8", "replace")
        except KeyError:
            raise Damaged from None

    def time(self) -> int:
        seconds, nanoseconds = struct.unpack("<II", struct.pack("<Q", self.number("time", "<Q")))
        return int(seconds) * 10**9 + int(nanoseconds)


class BagFile(BagSource):
    """An entry's location is (position of its chunk, offset in the chunk's data)."""

    def __init__(self, path: Path) -> None:
        super().__init__(path)
        self._connections: dict[int, str] = {}
        self._known_connections: set[int] = set()
        self._cached_chunk: tuple[int, bytes] = (0, b"")
        self._plain_chunks: dict[int, int] = {}  # the positions of those that are not packed, and of their data
        self._size = path.stat().st_size

    def list_images(self) -> None:
        stream = self._stream()
        if stream.read(len(MAGIC)) != MAGIC:
            raise InputError(f"{self.path} is not a ROS 1 bag of version 2.0, or its first bytes are damaged")
        chunks, complete = self._chunk_positions(stream)
        lost = 0
        for position in dict.fromkeys(chunks):
            try:
                lost += not self._index_chunk(stream, position)
            except (Damaged, InputError):
                lost += 1
        if not complete:
            problem = f"not indexed, cut short or damaged; the {self.image_count} images it still holds are used"
            self.problems.append(f"{self.path}: {problem}")
        if lost:
            self.problems.append(f"{self.path}: {lost} of {len(chunks)} chunks are damaged; images in them are lost")

    def _chunk_positions(self, stream: BinaryIO) -> tuple[list[int], bool]:
        """Where the chunks are, from the index at the end or by walking, and whether the bag is whole."""
        try:
            header = _record_at(stream, len(MAGIC))
            if header.kind != BAG_HEADER:
                raise Damaged
            return self._chunks_from_index(stream, header), True
        except Damaged:
            self._connections.clear()
            self._known_connections.clear()
        return self._chunks_by_walking(stream)

    def _chunks_from_index(self, stream: BinaryIO, header: Record) -> list[int]:
        position = header.number("index_pos", "<Q")
        connections, chunk_count = header.number("conn_count"), header.number("chunk_count")
        if not len(MAGIC) < position <= self._size or connections + chunk_count > self._size:
            raise Damaged
        wanted = [CONNECTION] * connections + [CHUNK_INFO] * chunk_count
        chunks = []
        for kind in wanted:
            self.budget.take(0)
            record = _record_at(stream, position)
            if record.kind != kind or record.end > self._size:
                raise Damaged
            if kind == CONNECTION:
                self._note_connection(stream, record)
            else:
                chunks.append(record.number("chunk_pos", "<Q"))
            position = record.end
        return chunks

    def _chunks_by_walking(self, stream: BinaryIO) -> tuple[list[int], bool]:
        chunks: list[int] = []
        position = len(MAGIC)
        try:
            while position < self._size:
                self.budget.take(0)
                record = _record_at(stream, position)
                if record.end > self._size:
                    return chunks, False
                if record.kind == CHUNK:
                    chunks.append(position)
                elif record.kind == CONNECTION:
                    self._note_connection(stream, record)
                position = record.end
        except Damaged:
            pass
        return chunks, False

    def _note_connection(self, stream: BinaryIO, record: Record) -> None:
        number, topic = record.number("conn"), topic_name(record.text("topic"))
        about = _fields(_read_exactly(stream, record.data, record.length))
        type_name = about.get(b"type", b"").decode("utf-8", "replace")
        self._known_connections.add(number)
        if self._add_topic(topic, type_name, "ros1"):
            self._connections[number] = topic

    def _index_chunk(self, stream: BinaryIO, position: int) -> bool:
        """List the images of a chunk from the index records that follow it, or else from its own records.

        False where some of its own records are lost.
        """
        chunk = _record_at(stream, position)
        if chunk.kind != CHUNK or chunk.end > self._size:
            raise Damaged
        if chunk.fields.get(b"compression") == b"none":
            self._plain_chunks[position] = chunk.data
        entries: list[tuple[int, Entry]] = []
        try:
            after = chunk.end
            while after < self._size:
                record = _record_at(stream, after)
                if record.kind != INDEX or record.number("conn") not in self._known_connections:
                    break
                entries += self._index_entries(stream, record, position)
                after = record.end
            indexed = after > chunk.end
        except Damaged:
            indexed = False
        whole = True
        if not indexed or self._follows_unknown_connection(stream, after):
            entries, whole = self._walk_chunk(stream, chunk, position)
        for connection, entry in entries:
            if connection in self._connections:
                self.entries[self._connections[connection]].append(entry)
        return whole

    def _follows_unknown_connection(self, stream: BinaryIO, position: int) -> bool:
        try:
            return position < self._size and _record_at(stream, position).kind == INDEX
        except Damaged:
            return False

    def _index_entries(self, stream: BinaryIO, record: Record, chunk: int) -> list[tuple[int, Entry]]:
        connection = record.number("conn")
        self.budget.enter(record.length // INDEX_ENTRY_BYTES)
        content = _read_exactly(stream, record.data, record.length)
        if record.number("ver") != 1 or len(content) != 12 * record.number("count"):
            raise Damaged
        return [
            (connection, Entry(seconds * 10**9 + nanoseconds, (chunk, offset)))
            for seconds, nanoseconds, offset in struct.iter_unpack("<III", content)
        ]

    def _walk_chunk(self, stream: BinaryIO, chunk: Record, position: int) -> tuple[list[tuple[int, Entry]], bool]:
        """Connections and entries of the messages in a chunk, and whether the chunk holds what it declares."""
        self.budget.take(chunk.number("size"))
        content = self._chunk_content(stream, chunk)
        records = BytesIO(content)
        entries = []
        offset = 0
        while offset < len(content):
            self.budget.take(0)
            record = _record_at(records, offset)
            if record.end > len(content):
                raise Damaged
            if record.kind == CONNECTION:
                self._note_connection(records, record)
            elif record.kind == MESSAGE:
                if record.number("conn") in self._connections:
                    self.budget.enter()
                entries.append((record.number("conn"), Entry(record.time(), (position, offset))))
            offset = record.end
        return entries, len(content) == chunk.number("size")

    def _chunk_content(self, stream: BinaryIO, chunk: Record) -> bytes:
        declared = chunk.number("size")
        if max(declared, chunk.length) > MAX_CHUNK_BYTES:
            raise InputError(f"a chunk declares {declared} bytes, too many")
        return decompress(_read_exactly(stream, chunk.data, chunk.length), chunk.text("compression"), declared)

    def read(self, topic: str, entry: Entry) -> bytes:
        position, offset = entry.location
        stream = self._stream()
        try:
            if self._cached_chunk[0] == position:
                return self._message(BytesIO(self._cached_chunk[1]), offset, topic, entry)
            if position in self._plain_chunks:
                return self._message(stream, self._plain_chunks[position] + offset, topic, entry)
            chunk = _record_at(stream, position)
            self._cached_chunk = (position, self._chunk_content(stream, chunk))
            return self._message(BytesIO(self._cached_chunk[1]), offset, topic, entry)
        except Damaged:
            raise InputError("the message is damaged or cut short") from None

    def _message(self, stream: BinaryIO, position: int, topic: str, entry: Entry) -> bytes:
        record = _record_at(stream, position)
        while record.kind == CONNECTION:  # an index may point at the connection that precedes its first message
            record = _record_at(stream, record.end)
        if record.kind != MESSAGE or record.length > MAX_MESSAGE_BYTES or record.time() != entry.stamp_ns:
            raise Damaged
        if self._connections.get(record.number("conn")) != topic:
            raise Damaged
        return _read_exactly(stream, record.data, record.length)

    def close(self) -> None:
        super().close()
        self._cached_chunk = (0, b"")

    def __getstate__(self) -> dict[str, Any]:
        return {**super().__getstate__(), "_cached_chunk": (0, b"")}


def _read_exactly(stream: BinaryIO, position: int, length: int) -> bytes:
    if position >= LAST_POSITION:
        raise Damaged
    stream.seek(position)
    content = stream.read(length)
    if len(content) != length:
        raise Damaged
    return content


def _record_at(stream: BinaryIO, position: int) -> Record:
    """A record: header length u32, header, data length u32, data (which is not read)."""
    (length,) = struct.unpack("<I", _read_exactly(stream, position, 4))
    if not 0 < length <= MAX_HEADER_BYTES:
        raise Damaged
    content = _read_exactly(stream, position + 4, length + 4)
    (data_length,) = struct.unpack("<I", content[length:])
    return Record(_fields(content[:length]), position + 8 + length, data_length)


def _fields(content: bytes) -> dict[bytes, bytes]:
    """A header: fields of length u32 and name=value."""
    fields = {}
    position = 0
    while position < len(content):
        if position + 4 > len(content):
            raise Damaged
        (length,) = struct.unpack_from("<I", content, position)
        field = content[position + 4 : position + 4 + length]
        name, separator, value = field.partition(b"=")
        if len(field) != length or not separator:
            raise Damaged
        fields[name] = value
        position += 4 + length
    return fields
