"""MCAP files of any profile: indexed, not indexed, unfinished or cut short."""

from __future__ import annotations

import struct
import zlib
from collections.abc import Iterator
from io import BytesIO
from pathlib import Path
from typing import Any, BinaryIO

from mcap.opcode import Opcode
from mcap.records import Channel, ChunkIndex, Footer, MessageIndex, Schema, Statistics

from fisheye_ep_calib.errors import InputError
from fisheye_ep_calib.storage.sources.base import MAX_MESSAGE_BYTES, BagSource, Entry, topic_name
from fisheye_ep_calib.storage.sources.mcap_records import (
    FOOTER_BYTES,
    MAGIC,
    MESSAGE_HEADER_BYTES,
    ChunkHeader,
    CutShort,
    Record,
    chunk_content,
    chunk_header,
    parse,
    read_exactly,
    record_at,
    walk,
)

# A chunk without compression is read whole, and its checksum verified, up to this size; beyond, only the
# message is read, so that one frame of a file that is one chunk does not cost the file.
VERIFIED_CHUNK_BYTES = 2**24
OUTSIDE_CHUNKS = -1
DATA_END_BYTES = 4
INDEX_ENTRY_BYTES = 16


class McapFile(BagSource):
    """An entry's location is (position of its chunk, offset in the chunk), or (OUTSIDE_CHUNKS, position)."""

    def __init__(self, path: Path) -> None:
        super().__init__(path)
        self._schemas: dict[int, str] = {}
        self._channels: dict[int, str] = {}
        self._cached_chunk: tuple[int, bytes] = (0, b"")
        self._size = path.stat().st_size

    def list_images(self) -> None:
        stream = self._stream()
        if stream.read(len(MAGIC)) != MAGIC:
            raise InputError(f"{self.path} is not an MCAP file, or its first bytes are damaged")
        if not self._index_from_summary(stream):
            self._forget()
            self._index_by_walking(stream)

    def _forget(self) -> None:
        for table in (self.topics, self.entries, self.encodings, self._schemas, self._channels):
            table.clear()

    def _index_from_summary(self, stream: BinaryIO) -> bool:
        """List the images from the summary at the file's end; False where it is missing or damaged."""
        try:
            end = self._size - len(MAGIC) - FOOTER_BYTES
            if end < len(MAGIC) or read_exactly(stream, self._size - len(MAGIC), len(MAGIC)) != MAGIC:
                return False
            footer_record = record_at(stream, end)
            footer = parse(stream, footer_record, Footer)
            if footer_record.opcode != Opcode.FOOTER or not 0 < footer.summary_start < end:
                return False
            if footer.summary_crc and footer.summary_crc != self._summary_checksum(stream, footer, end):
                return False
            return self._read_summary(stream, footer.summary_start, end)
        except CutShort:
            return False

    def _summary_checksum(self, stream: BinaryIO, footer: Footer, footer_position: int) -> int:
        """Over the summary and the footer up to the checksum itself."""
        length = footer_position + FOOTER_BYTES - 4 - footer.summary_start
        return zlib.crc32(read_exactly(stream, footer.summary_start, length))

    def _read_summary(self, stream: BinaryIO, start: int, end: int) -> bool:
        chunks: list[ChunkIndex] = []
        counts: dict[int, int] = {}
        for record in list(self._walk(stream, start, end)):
            if record.opcode == Opcode.CHUNK_INDEX:
                chunks.append(parse(stream, record, ChunkIndex))
            elif record.opcode == Opcode.STATISTICS:
                counts = parse(stream, record, Statistics).channel_message_counts
            else:
                self._note(stream, record)
        if not chunks or not self.topics:
            return False
        for chunk in {chunk.chunk_start_offset: chunk for chunk in chunks}.values():
            if not chunk.message_index_offsets and chunk.message_index_length == 0:
                if not self._index_chunk(stream, record_at(stream, chunk.chunk_start_offset)):
                    return False
            for channel, position in chunk.message_index_offsets.items():
                if channel in self._channels:
                    self._read_message_index(stream, channel, position, chunk.chunk_start_offset)
        if not counts:
            return not self._has_loose_messages(stream, start)
        return self.image_count == self._counted(counts)

    def _has_loose_messages(self, stream: BinaryIO, end: int) -> bool:
        """Whether there are messages outside chunks, of which an index of chunks says nothing."""
        return any(record.opcode == Opcode.MESSAGE for record in self._walk(stream, len(MAGIC), end))

    def _counted(self, counts: dict[int, int]) -> int:
        """How many images the file's statistics (channel → messages) speak of."""
        return sum(counts.get(channel, 0) for channel in self._channels)

    def _read_message_index(self, stream: BinaryIO, channel: int, position: int, chunk_position: int) -> None:
        record = record_at(stream, position)
        self.budget.enter(record.length // INDEX_ENTRY_BYTES)
        index = parse(stream, record, MessageIndex)
        if record.opcode != Opcode.MESSAGE_INDEX or index.channel_id != channel:
            raise CutShort(position)
        entries = self.entries[self._channels[channel]]
        entries.extend(Entry(stamp, (chunk_position, offset)) for stamp, offset in index.records)

    def _index_by_walking(self, stream: BinaryIO) -> None:
        """List the images by going from record to record, for as long as they make sense."""
        damaged = 0
        ended = False
        counts: dict[int, int] = {}
        try:
            for record in self._walk(stream, len(MAGIC), self._size):
                if record.opcode == Opcode.FOOTER:
                    break
                if record.opcode == Opcode.DATA_END:
                    if record.length != DATA_END_BYTES:
                        raise CutShort(record.position)
                    ended = True
                elif record.opcode == Opcode.STATISTICS:
                    counts = parse(stream, record, Statistics).channel_message_counts
                elif record.opcode == Opcode.CHUNK:
                    damaged += not self._index_chunk(stream, record)
                else:
                    damaged += not self._note_if_whole(stream, record)
            if not ended:
                self._say_cut_short(self._size)
        except CutShort as cut:
            if not ended:
                self._say_cut_short(cut.position)
        if damaged:
            self.problems.append(f"{self.path}: what {damaged} damaged or incomplete records held is lost")
        elif ended and self.image_count < self._counted(counts):
            self.problems.append(f"{self.path}: {self._counted(counts) - self.image_count} images are lost")

    def _say_cut_short(self, position: int) -> None:
        percent = 100 * position / self._size
        if percent >= 99.5:
            problem = f"unfinished or cut short; the {self.image_count} images it still holds are used"
        else:
            problem = (
                f"cut short or damaged; the {self.image_count} images before {percent:.0f} % of its length are used"
            )
        self.problems.append(f"{self.path}: {problem}")

    def _index_chunk(self, stream: BinaryIO, record: Record) -> bool:
        """List the images of a chunk; False where some of it is lost."""
        try:
            header = chunk_header(stream, record)
            if not header.compression:
                end = min(header.data + header.data_bytes, self._size)
                whole = end == header.data + header.data_bytes
                return self._index_chunk_records(stream, record.position, header.data, end) and whole
            self.budget.take(header.uncompressed_bytes)
            content = chunk_content(stream, header)
            return self._index_chunk_records(BytesIO(content), record.position, 0, len(content))
        except (CutShort, InputError):
            return False

    def _index_chunk_records(self, stream: BinaryIO, chunk_position: int, start: int, end: int) -> bool:
        whole = True
        for record in self._walk(stream, start, end):
            if record.end <= end:
                whole &= self._note_if_whole(stream, record, chunk_position, start)
        return whole

    def _walk(self, stream: BinaryIO, start: int, end: int) -> Iterator[Record]:
        for record in walk(stream, start, end):
            self.budget.take(0)
            yield record

    def _note_if_whole(
        self, stream: BinaryIO, record: Record, chunk_position: int = OUTSIDE_CHUNKS, start: int = 0
    ) -> bool:
        try:
            self._note(stream, record, chunk_position, start)
        except CutShort:
            return False
        return True

    def _note(self, stream: BinaryIO, record: Record, chunk_position: int = OUTSIDE_CHUNKS, start: int = 0) -> None:
        """Remember a schema, a channel, or where an image is; everything else is passed over."""
        if record.opcode == Opcode.SCHEMA:
            schema = parse(stream, record, Schema)
            self._schemas[schema.id] = schema.name
        elif record.opcode == Opcode.CHANNEL:
            channel = parse(stream, record, Channel)
            type_name = self._schemas.get(channel.schema_id, "")
            topic = topic_name(channel.topic)
            if self._add_topic(topic, type_name, channel.message_encoding):
                self._channels[channel.id] = topic
        elif record.opcode == Opcode.MESSAGE:
            if record.length < MESSAGE_HEADER_BYTES:
                raise CutShort(record.position)
            channel_id, _, stamp = struct.unpack("<HIQ", read_exactly(stream, record.content, 14))
            if channel_id in self._channels:
                self.budget.enter()
                location = (chunk_position, record.position - start)
                self.entries[self._channels[channel_id]].append(Entry(stamp, location))

    def read(self, topic: str, entry: Entry) -> bytes:
        chunk_position, offset = entry.location
        stream = self._stream()
        try:
            if chunk_position == OUTSIDE_CHUNKS:
                return self._message(stream, offset, topic, entry)
            if self._cached_chunk[0] != chunk_position:
                header = chunk_header(stream, record_at(stream, chunk_position))
                if not header.compression and not self._worth_verifying(header):
                    return self._message(stream, header.data + offset, topic, entry)
                self._cached_chunk = (chunk_position, chunk_content(stream, header))
            return self._message(BytesIO(self._cached_chunk[1]), offset, topic, entry)
        except CutShort:
            raise InputError("the message is damaged or cut short") from None

    def _worth_verifying(self, header: ChunkHeader) -> bool:
        return header.data_bytes <= VERIFIED_CHUNK_BYTES and header.data + header.data_bytes <= self._size

    def _message(self, stream: BinaryIO, position: int, topic: str, entry: Entry) -> bytes:
        record = record_at(stream, position)
        if record.opcode != Opcode.MESSAGE or not MESSAGE_HEADER_BYTES <= record.length <= MAX_MESSAGE_BYTES:
            raise CutShort(position)
        channel_id, _, stamp = struct.unpack("<HIQ", read_exactly(stream, record.content, 14))
        if self._channels.get(channel_id) != topic or stamp != entry.stamp_ns:
            raise CutShort(position)
        content = record.content + MESSAGE_HEADER_BYTES
        return read_exactly(stream, content, record.length - MESSAGE_HEADER_BYTES)

    def close(self) -> None:
        super().close()
        self._cached_chunk = (0, b"")

    def __getstate__(self) -> dict[str, Any]:
        return {**super().__getstate__(), "_cached_chunk": (0, b"")}
