"""Walking the records of an MCAP file, or of one of its chunks, without reading what they hold.

The format: https://mcap.dev/spec. A record is an opcode (1 byte), a length (8 bytes) and its content.
"""

from __future__ import annotations

import struct
import zlib
from collections.abc import Iterator
from io import BytesIO
from typing import BinaryIO, NamedTuple, Protocol, TypeVar

from mcap.data_stream import ReadDataStream
from mcap.opcode import Opcode

from fisheye_ep_calib.errors import InputError
from fisheye_ep_calib.storage.compression import decompress

MAGIC = b"\x89MCAP0\r\n"
HEADER_BYTES = 9
FOOTER_BYTES = HEADER_BYTES + 20
MESSAGE_HEADER_BYTES = 22
MAX_CHUNK_BYTES = 2**28  # packed ones; of others only the messages are read
MAX_SMALL_RECORD_BYTES = 2**22
LAST_POSITION = 2**62  # beyond any file, within what seek() takes


_Kind = TypeVar("_Kind", covariant=True)


class RecordClass(Protocol[_Kind]):
    """One of the mcap package's classes of records."""

    @staticmethod
    def read(stream: ReadDataStream) -> _Kind: ...


class CutShort(Exception):
    """The data ends, or stops making sense, at ``position``."""

    def __init__(self, position: int) -> None:
        super().__init__(position)
        self.position = position


class Record(NamedTuple):
    """An opcode, and where the record and its content lie in the stream."""

    opcode: int
    position: int
    length: int

    @property
    def content(self) -> int:
        return self.position + HEADER_BYTES

    @property
    def end(self) -> int:
        return self.content + self.length


class ChunkHeader(NamedTuple):
    """A chunk's compression, its checksum (0: none), its size once decompressed, and where its data lies."""

    compression: str
    checksum: int
    uncompressed_bytes: int
    data: int
    data_bytes: int


def read_exactly(stream: BinaryIO, position: int, length: int) -> bytes:
    if position >= LAST_POSITION:
        raise CutShort(position)
    stream.seek(position)
    content = stream.read(length)
    if len(content) != length:
        raise CutShort(position)
    return content


def record_at(stream: BinaryIO, position: int) -> Record:
    opcode, length = struct.unpack("<BQ", read_exactly(stream, position, HEADER_BYTES))
    if opcode == 0 or length >= LAST_POSITION:
        raise CutShort(position)
    return Record(opcode, position, length)


def walk(stream: BinaryIO, position: int, end: int) -> Iterator[Record]:
    """The records from ``position`` on; after one that reaches beyond ``end``, CutShort is raised."""
    while position < end:
        record = record_at(stream, position)
        yield record
        if record.end > end:
            raise CutShort(position)
        position = record.end


def parse(stream: BinaryIO, record: Record, kind: RecordClass[_Kind]) -> _Kind:
    """The record as one of the mcap package's record classes. Raises CutShort where it makes no sense."""
    if record.length > MAX_SMALL_RECORD_BYTES:
        raise CutShort(record.position)
    content = read_exactly(stream, record.content, record.length)
    try:
        return kind.read(ReadDataStream(BytesIO(content)))
    except Exception:  # the mcap package raises whatever its bytes lead to
        raise CutShort(record.position) from None


def chunk_header(stream: BinaryIO, record: Record) -> ChunkHeader:
    """start u64, end u64, uncompressed size u64, crc u32, compression (u32 and text), data size u64, data."""
    if record.opcode != Opcode.CHUNK:
        raise CutShort(record.position)
    start = read_exactly(stream, record.content, 32)
    uncompressed_bytes, checksum, name_length = struct.unpack_from("<QII", start, 16)
    if name_length > 16:
        raise CutShort(record.position)
    rest = read_exactly(stream, record.content + 32, name_length + 8)
    (data_bytes,) = struct.unpack_from("<Q", rest, name_length)
    data = record.content + 40 + name_length
    if data + data_bytes > record.end:
        raise CutShort(record.position)
    compression = rest[:name_length].decode("ascii", "replace")
    return ChunkHeader(compression, checksum, uncompressed_bytes, data, data_bytes)


def chunk_content(stream: BinaryIO, header: ChunkHeader) -> bytes:
    """The chunk's records, decompressed and checked. Raises InputError or CutShort."""
    if max(header.uncompressed_bytes, header.data_bytes) > MAX_CHUNK_BYTES:
        raise InputError(f"a chunk declares {header.uncompressed_bytes} bytes, too many")
    packed = read_exactly(stream, header.data, header.data_bytes)
    content = decompress(packed, header.compression, header.uncompressed_bytes)
    if len(content) != header.uncompressed_bytes:
        raise InputError("a chunk holds less than it declares")
    if header.checksum and zlib.crc32(content) != header.checksum:
        raise InputError("a chunk's checksum does not agree with its data")
    return content
