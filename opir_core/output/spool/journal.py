"""The spool's file: parcels in SQLite, in write-ahead-log mode, bounded, and held by one process at a time.

What `put` has returned from survives the end of the process, SIGKILL included: a transaction in the log is complete or
not there (https://www.sqlite.org/wal.html). A row's checksum finds damage that SQLite does not look for.
"""

import json
import sqlite3
from collections.abc import Callable, Iterable
from contextlib import suppress
from functools import wraps
from pathlib import Path
from typing import Any, ParamSpec, TypeVar
from zlib import crc32

import numpy as np

from opir_core.errors import SinkError
from opir_core.interfaces.records import Batch
from opir_core.output.spool.batches import FullError

#: "OPIR", so that a SQLite file of something else is told from a spool.
_APPLICATION = 0x4F504952
_VERSION = 1
_PAGE_BYTES = 4096
#: What a row costs besides its contents: its numbers, texts and cell, and the pages it shares or does not fill.
_ROW_BYTES = 128
#: Pages for the schema, the table's interior and the free list.
_SPARE_PAGES = 32
_LOG_BYTES = 1 << 22

_TABLE = """CREATE TABLE IF NOT EXISTS parcel (
    number INTEGER PRIMARY KEY AUTOINCREMENT, events INTEGER NOT NULL, bytes INTEGER NOT NULL, crc INTEGER NOT NULL,
    content_type TEXT NOT NULL, schema_version TEXT NOT NULL, keys TEXT NOT NULL, key_of BLOB NOT NULL,
    body BLOB NOT NULL)"""
_INSERT = (
    "INSERT INTO parcel (events, bytes, crc, content_type, schema_version, keys, key_of, body)"
    " VALUES (?, ?, ?, ?, ?, ?, ?, ?)"
)
_NEXT = (
    "SELECT number, crc, content_type, schema_version, keys, key_of, body FROM parcel"
    " WHERE number > ? ORDER BY number LIMIT 1"
)

_P = ParamSpec("_P")
_T = TypeVar("_T")


def _told(method: Callable[_P, _T]) -> Callable[_P, _T]:
    """Let what SQLite raises in a method be said in our words; a disk without room is a `FullError`."""

    @wraps(method)
    def telling(*args: _P.args, **kwargs: _P.kwargs) -> _T:
        try:
            return method(*args, **kwargs)
        except sqlite3.Error as error:
            if _code(error) == "SQLITE_FULL":
                raise FullError from error
            journal: Any = args[0]
            raise complaint(journal.path, error) from error

    return telling


class Journal:
    """Parcels in a file; `Journal(path, ...)` opens it, with what an earlier run left in it."""

    outlives_the_process = True

    def __init__(self, path: str, max_bytes: int, *, survives_power_cut: bool = False) -> None:
        self.path = path
        self._max_bytes = max_bytes
        self._bytes = 0
        self.waiting = 0
        try:
            absolute = str(Path(path).absolute())  # else ":memory:" would be no file
            self._database = sqlite3.connect(absolute, timeout=0.0, isolation_level=None, check_same_thread=False)
        except sqlite3.Error as error:
            raise complaint(path, error) from error
        try:
            self._open(survives_power_cut)
        except FullError as error:
            self.close()
            raise SinkError(f"the spool {path} {_WORDS['SQLITE_FULL']}") from error
        except BaseException:
            self.close()
            raise

    @_told
    def put(self, parcel: Batch) -> None:
        """Write a parcel down; raise `FullError` where there is no room for it in the file or on its disk."""
        key_of = parcel.key_of.astype("<u2").tobytes()
        cost = _cost(parcel)
        if self.waiting and self._bytes + cost > self._max_bytes:
            raise FullError
        kind = (parcel.content_type, parcel.schema_version, json.dumps(parcel.keys))
        row = (len(parcel), cost, _checksum(*kind, key_of, parcel.body), *kind, key_of, parcel.body)
        self._database.execute(_INSERT, row)
        self._bytes += cost
        self.waiting += len(parcel)

    @_told
    def after(self, number: int) -> tuple[int, Batch] | None:
        """Return the first parcel with a number above that, or None; raise `SinkError` where it is damaged."""
        row = self._database.execute(_NEXT, (number,)).fetchone()
        if row is None:
            return None
        found, crc, content_type, schema_version, keys, key_of, body = row
        if _checksum(content_type, schema_version, keys, key_of, body) != crc:
            raise SinkError(f"the spool {self.path} is damaged: parcel {found} is not what was written; {_MOVE}")
        return found, Batch(
            body=body,
            keys=tuple(json.loads(keys)),
            key_of=np.frombuffer(key_of, dtype="<u2").astype(np.uint16),
            content_type=content_type,
            schema_version=schema_version,
        )

    @_told
    def acknowledge(self, numbers: Iterable[int]) -> None:
        """Forget the parcels of those numbers, all or none."""
        gone = [(number,) for number in numbers]
        events, cost = 0, 0
        self._database.execute("BEGIN")
        try:
            for each in gone:
                row = self._database.execute("DELETE FROM parcel WHERE number = ? RETURNING events, bytes", each)
                (found,) = row.fetchall()
                events, cost = events + found[0], cost + found[1]
            self._database.execute("COMMIT")
        except sqlite3.Error:
            if self._database.in_transaction:
                self._database.execute("ROLLBACK")
            raise
        self.waiting -= events
        self._bytes -= cost

    @_told
    def drop_oldest(self, after: int) -> int:
        """Forget the first parcel with a number above that and return how many events it had; 0 where there is none."""
        row = self._database.execute("SELECT min(number) FROM parcel WHERE number > ?", (after,)).fetchone()
        if row[0] is None:
            return 0
        before = self.waiting
        self.acknowledge([row[0]])
        return before - self.waiting

    def close(self) -> None:
        """Close the file; its log is taken into it where there is room, and is read at the next opening where not."""
        with suppress(sqlite3.Error):
            self._database.close()

    @_told
    def _open(self, survives_power_cut: bool) -> None:
        execute = self._database.execute
        pages = self._max_bytes // _PAGE_BYTES + _SPARE_PAGES
        for pragma in (
            f"page_size = {_PAGE_BYTES}",
            "locking_mode = EXCLUSIVE",
            "journal_mode = WAL",
            f"journal_size_limit = {_LOG_BYTES}",
            f"synchronous = {'FULL' if survives_power_cut else 'NORMAL'}",
        ):
            told = execute(f"PRAGMA {pragma}").fetchall()
            if pragma == "journal_mode = WAL" and told != [("wal",)]:
                raise SinkError(f"the spool {self.path} is on a disk that cannot hold one; give a path on another disk")
        execute("BEGIN EXCLUSIVE")
        self._require_spool()
        execute(_TABLE)
        execute("COMMIT")
        execute(f"PRAGMA max_page_count = {pages}")
        self.waiting, self._bytes = execute("SELECT total(events), total(bytes) FROM parcel").fetchone()
        self.waiting, self._bytes = int(self.waiting), int(self._bytes)

    def _require_spool(self) -> None:
        """Refuse a database of something else; make a new one ours."""
        execute = self._database.execute
        (application,), (version,) = (
            execute(f"PRAGMA {each}").fetchone() for each in ("application_id", "user_version")
        )
        tables = execute("SELECT count(*) FROM sqlite_master").fetchone()[0]
        if not tables and not application:
            execute(f"PRAGMA application_id = {_APPLICATION}")
            execute(f"PRAGMA user_version = {_VERSION}")
        elif application != _APPLICATION:
            raise SinkError(f"{self.path} is a database of something else, not a spool; give the spool another path")
        elif version != _VERSION:
            raise SinkError(f"the spool {self.path} has version {version}, and this opir reads {_VERSION}; {_MOVE}")


_MOVE = "move it away, and a new one is made"

_WORDS = {
    "SQLITE_BUSY": "is in use by another process; stop that, or give each output a spool of its own",
    "SQLITE_LOCKED": "is in use by another process; stop that, or give each output a spool of its own",
    "SQLITE_NOTADB": f"is not a spool, or damaged; {_MOVE}",
    "SQLITE_CORRUPT": f"is damaged; {_MOVE}",
    "SQLITE_CANTOPEN": "cannot be opened; give a path, in a folder that exists, that may be written",
    "SQLITE_READONLY": "may not be written; give a path that may",
    "SQLITE_PERM": "may not be written; give a path that may",
    "SQLITE_FULL": "has no room on its disk; make room, or give a path on another disk",
}


def complaint(path: str, error: sqlite3.Error) -> SinkError:
    """Return what to say of an error of SQLite."""
    folder = Path(path).parent
    if _code(error) == "SQLITE_CANTOPEN" and not folder.is_dir():
        return SinkError(f"the spool {path} cannot be made: there is no folder {str(folder)!r}; make it")
    words = _WORDS.get(_code(error), f"cannot be used ({error}); give it another path")
    return SinkError(f"the spool {path} {words}")


def _code(error: sqlite3.Error) -> str:
    """Return SQLite's primary error code; extended codes begin with it (https://www.sqlite.org/rescode.html)."""
    name: Any = getattr(error, "sqlite_errorname", "") or ""
    return "_".join(name.split("_")[:2])


def _cost(parcel: Batch) -> int:
    """Return at least what a row takes in the file: a small one may leave as much of its page empty as it fills."""
    content = len(parcel.body) + 2 * len(parcel) + sum(6 * len(key) + 4 for key in parcel.keys) + _ROW_BYTES
    return content + min(content, 2 * _PAGE_BYTES)


def _checksum(*parts: str | bytes) -> int:
    crc = 0
    for part in parts:
        crc = crc32(part if isinstance(part, bytes) else part.encode("utf-8", "surrogatepass"), crc)
    return crc
