"""rosbag2's SQLite files, whole or damaged."""

from __future__ import annotations

import sqlite3
from collections.abc import Iterator
from pathlib import Path
from urllib.parse import quote

from fisheye_ep_calib.errors import InputError
from fisheye_ep_calib.storage.sources.base import MAX_MESSAGE_BYTES, BagSource, Entry

MAGIC = b"SQLite format 3\0"


class Db3File(BagSource):
    """An entry's location is (row of the table ``messages``,)."""

    def __init__(self, path: Path) -> None:
        super().__init__(path)
        topics = self._topics()
        if not topics:
            raise InputError(f"{path} holds no topics")
        rows: list[tuple] = []
        complete = self._collect(rows, "ASC", None)
        if not complete:
            # What lies beyond the damage may still be reached from the other end.
            self._collect(rows, "DESC", rows[-1][0] if rows else None)
            self.problems.append(f"{path}: the database is cut short or damaged; what can be read is used")
        for row, topic_id, stamp in sorted(rows, key=lambda row: (row[2], row[0])):
            if topic_id in topics:
                self.entries[topics[topic_id]].append(Entry(stamp, (row,)))

    def _topics(self) -> dict[int, str]:
        """Note every topic; returns those of images by their id."""
        images = {}
        try:
            query = "SELECT id, name, type, serialization_format FROM topics"
            for topic_id, name, type_name, encoding in self._connection().execute(query):
                if self._add_topic(str(name), str(type_name), str(encoding)):
                    images[topic_id] = str(name)
        except sqlite3.Error as error:
            if not self.topics:
                raise InputError(f"{self.path} is not a rosbag2 database, or is damaged: {error}") from None
            self.problems.append(f"{self.path}: some topics are lost ({error})")
        return images or {-1: ""} if self.topics else {}

    def _collect(self, rows: list[tuple], direction: str, stop_at: int | None) -> bool:
        """Append (row, topic, time) of every message; False where the database stops being readable."""
        # Not by an index: the table is what is read later, and what is damaged in it shows here.
        query = f"SELECT id, topic_id, timestamp FROM messages NOT INDEXED ORDER BY id {direction}"
        try:
            for row in self._whole_rows(self._connection().execute(query)):
                if row[0] == stop_at:
                    break
                rows.append(row)
        except sqlite3.Error:
            return False
        return True

    @staticmethod
    def _whole_rows(rows) -> Iterator[tuple]:
        return (row for row in rows if all(isinstance(value, int) for value in row))

    def _connection(self) -> sqlite3.Connection:
        if self._file is None:
            journal = Path(f"{self.path}-wal")
            pending = journal.exists() and journal.stat().st_size > 0
            # Immutable: nothing is created beside the user's file. Not where the recorder left its journal.
            options = "mode=ro" if pending else "mode=ro&immutable=1"
            uri = f"file:{quote(str(self.path.absolute()))}?{options}"
            try:
                self._file = sqlite3.connect(uri, uri=True, check_same_thread=False)
                self._file.text_factory = lambda text: text.decode("utf-8", "replace")
                self._file.execute("PRAGMA cell_size_check = ON")
                # The name misleads: it makes SQLite read a file that is shorter than it says it is.
                self._file.execute("PRAGMA writable_schema = ON")
            except sqlite3.Error as error:
                raise InputError(f"{self.path} cannot be opened: {error}") from None
        return self._file

    def read(self, topic: str, entry: Entry) -> bytes:
        try:
            size_query = "SELECT length(data), typeof(data) FROM messages WHERE id = ?"
            size, kind = self._connection().execute(size_query, entry.location).fetchone() or (0, "")
            if kind != "blob" or size > MAX_MESSAGE_BYTES:
                raise InputError("the message is damaged")
            query = "SELECT data FROM messages WHERE id = ?"
            (content,) = self._connection().execute(query, entry.location).fetchone()
        except (sqlite3.Error, OverflowError) as error:
            raise InputError(f"the message is damaged ({error})") from None
        return content
