"""rosbag2's SQLite files, whole or damaged."""

from __future__ import annotations

import os
import sqlite3
import struct
import time
from functools import cached_property
from pathlib import Path
from urllib.parse import quote

from fisheye_ep_calib.errors import InputError
from fisheye_ep_calib.outside import open_outside
from fisheye_ep_calib.storage.sources.base import MAX_MESSAGE_BYTES, BagSource, Entry, topic_name
from fisheye_ep_calib.storage.sources.open_files import note_use

_TABLES = ("topics", "messages")
_MESSAGE = "SELECT CASE WHEN typeof(data) = 'blob' AND length(data) <= ? THEN data END FROM messages WHERE id = ?"
_MOST_COLUMNS = 100
_STEPS = 100_000  # of SQLite's machine, between two looks at the clock
_SECONDS = 10.0  # of processor time without a row
_LEAST_LIMIT = 2**16
_LIMIT_LENGTH = 0  # SQLITE_LIMIT_LENGTH, of a value: none is larger than its file


class Db3File(BagSource):
    """An entry's location is (row of the table ``messages``,)."""

    def __init__(self, path: Path) -> None:
        super().__init__(path)
        self._asked: float | None = None  # when SQLite first asked whether it may go on, since the last row

    def list_images(self) -> None:
        self._refuse_programs()
        self._connection().execute("PRAGMA cell_size_check = ON")  # finds damage; too slow for reading images
        topics = self._topics()
        if not topics:
            raise InputError(f"{self.path} holds no topics")
        rows: list[tuple[int, int, int]] = []
        complete = self._collect(rows, "ASC", None)
        if not complete:
            # What lies beyond the damage may still be reached from the other end.
            self._collect(rows, "DESC", rows[-1][0] if rows else None)
        if not complete or self._is_cut_short():
            problem = f"cut short or damaged; the {len(rows)} messages that can be read are used"
            self.problems.append(f"{self.path}: the database is {problem}")
        if self._journal_pends() and not self._may_write_beside():
            self.problems.append(
                f"{self.path}: its latest messages are in a journal that can only be read where one may write; "
                "copy the folder to such a place"
            )
        self._connection().execute("PRAGMA cell_size_check = OFF")
        for row, topic_id, stamp in sorted(rows):
            if topic_id in topics:
                self.entries[topics[topic_id]].append(Entry(stamp, (row,)))

    def _refuse_programs(self) -> None:
        """Raises InputError unless topics and messages are plain tables: a view, a virtual table or a column that is
        calculated is a program that somebody else wrote.
        """
        connection = self._connection()
        try:
            for table in _TABLES:
                query = "SELECT type, substr(sql, 1, 13), rootpage FROM sqlite_master WHERE name = ?"
                rows = connection.execute(query, (table,)).fetchmany(2)
                if not rows:
                    raise InputError(f"{self.path} is not a rosbag2 database: no such table: {table}")
                plain = len(rows) == 1 and rows[0][:2] == ("table", "CREATE TABLE ") and (rows[0][2] or 0) > 0
                columns = connection.execute(f"PRAGMA table_xinfo({table})").fetchmany(_MOST_COLUMNS)
                if not plain or any(column[6] for column in columns):
                    raise InputError(f"{self.path} is not a rosbag2 database: {table} is no plain table")
                if table == "messages" and ("id", "INTEGER", 1) not in {
                    (column[1], str(column[2]).upper(), column[5]) for column in columns
                }:
                    raise InputError(f"{self.path} is not a rosbag2 database: its messages have no numbers")
        except sqlite3.Error as error:
            raise InputError(f"{self.path} is not a rosbag2 database, or is damaged: {error}") from None

    def _topics(self) -> dict[int, str]:
        """Note every topic; returns those of images by their id."""
        images = {}
        try:
            query = "SELECT id, name, type, serialization_format FROM topics"
            for topic_id, name, type_name, encoding in self._connection().execute(query):
                self.budget.take(0)
                topic = topic_name(str(name))
                if self._add_topic(topic, str(type_name), str(encoding)):
                    images[topic_id] = topic
        except sqlite3.Error as error:
            if not self.topics:
                raise InputError(f"{self.path} is not a rosbag2 database, or is damaged: {error}") from None
            self.problems.append(f"{self.path}: some topics are lost ({error})")
        return images or {-1: ""} if self.topics else {}

    def _collect(self, rows: list[tuple[int, int, int]], direction: str, stop_at: int | None) -> bool:
        """Append (row, topic, time) of every message; False where some cannot be read."""
        complete, last = True, None
        # Not by an index: the table is what is read later, and what is damaged in it shows here.
        query = f"SELECT id, topic_id, timestamp FROM messages NOT INDEXED ORDER BY id {direction}"
        try:
            for row in self._connection().execute(query):
                if row[0] == stop_at:
                    break
                if last is not None and (row[0] <= last if direction == "ASC" else row[0] >= last):
                    return False  # pages that lead back to one another
                last = row[0]
                self.budget.enter()
                self._asked = None
                if all(isinstance(value, int) for value in row):
                    rows.append(row)
                else:
                    complete = False
        except sqlite3.Error:
            return False
        return complete

    def _is_cut_short(self) -> bool:
        """Whether the file is shorter than its header says: page size at byte 16, number of pages at 28."""
        with open_outside(self.path) as file:
            header = file.read(32)
        (page_size,) = struct.unpack_from(">H", header, 16)
        (pages,) = struct.unpack_from(">I", header, 28)
        whole: int = (65536 if page_size == 1 else page_size) * pages
        return self.path.stat().st_size < whole

    def _connection(self) -> sqlite3.Connection:
        file: sqlite3.Connection | None = self._file
        if file is None:
            # Immutable: nothing is created beside the user's file. Not where the recorder left its journal.
            journal = self._journal_pends() and self._may_write_beside()
            options = "mode=ro" if journal else "mode=ro&immutable=1"
            uri = f"file:{quote(str(self.path.absolute()))}?{options}"
            try:
                self._file = file = sqlite3.connect(uri, uri=True, check_same_thread=False)
                file.set_progress_handler(self._may_go_on, _STEPS)
                if hasattr(file, "setlimit"):  # from Python 3.11 on
                    file.setlimit(_LIMIT_LENGTH, self._most_bytes)
                file.text_factory = lambda text: text.decode("utf-8", "replace")
                # The name misleads: it makes SQLite read a file that is shorter than it says it is.
                file.execute("PRAGMA writable_schema = ON")
            except sqlite3.Error as error:
                raise InputError(f"{self.path} cannot be opened: {error}") from None
        note_use(self)
        return file

    def _journal_pends(self) -> bool:
        journal = Path(f"{self.path}-wal")
        return journal.exists() and journal.stat().st_size > 0

    def _may_write_beside(self) -> bool:
        """SQLite reads a journal only there."""
        return os.access(self.path.absolute().parent, os.W_OK)

    @cached_property
    def _most_bytes(self) -> int:
        """Of a value: it is no larger than its file, with the journal where there is one."""
        journal = Path(f"{self.path}-wal")
        whole = self.path.stat().st_size + (journal.stat().st_size if journal.exists() else 0)
        return min(MAX_MESSAGE_BYTES, whole + _LEAST_LIMIT)

    def _may_go_on(self) -> bool:
        """Asked by SQLite every so many steps; true ends what it does, with an error."""
        now = time.process_time()
        if self._asked is None:
            self._asked = now
        return now - self._asked > _SECONDS

    def read(self, topic: str, entry: Entry) -> bytes:
        try:
            self._asked = None
            row = self._connection().execute(_MESSAGE, (self._most_bytes, *entry.location)).fetchone()
        except (sqlite3.Error, OverflowError) as error:
            raise InputError(f"the message is damaged ({error})") from None
        if row is None or row[0] is None:
            raise InputError("the message is damaged")
        content: bytes = row[0]
        return content
