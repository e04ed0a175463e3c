"""The spool's file: batches in SQLite, in write-ahead-log mode, of limited size, open in one
process at a time.

A batch survives the end of the process, SIGKILL included, once `put` has returned: a transaction in
the log is complete or absent (https://www.sqlite.org/wal.html). The checksum of a row detects
damage that SQLite does not look for.
"""

import json
import sqlite3
import sys
from collections.abc import Callable, Iterable, Sequence
from contextlib import suppress
from functools import partial, wraps
from pathlib import Path
from typing import Any, ParamSpec, TypeVar
from zlib import crc32

import numpy as np

from opir_core.errors import SinkError
from opir_core.interfaces.records import Batch
from opir_core.output.spool.batches import DamagedError, FullError
from opir_core.output.spool.syncing import SPOOL_SYNC_S, SyncThread
from opir_core.output.temporary_files import NamedFile, sync_path

#: "OPIR": distinguishes a spool from other SQLite files.
_APPLICATION = 0x4F504952
_VERSION = 1
_PAGE_BYTES = 4096
#: Bytes of a row beside its contents: numbers, texts, cell, and its share of pages that are not
#: full.
_ROW_BYTES = 128
#: Pages of the schema, the table's interior and the free list.
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
_REPLACE = (
    "UPDATE parcel SET events = ?, bytes = ?, crc = ?, content_type = ?, schema_version = ?, keys ="
    " ?, key_of = ?,"
    " body = ? WHERE number = ?"
)
_NEXT = (
    "SELECT number, events, bytes, crc, content_type, schema_version, keys, key_of, body FROM"
    " parcel"
    " WHERE number > ? ORDER BY number LIMIT 1"
)

_P = ParamSpec("_P")
_T = TypeVar("_T")


def _raises_ours(method: Callable[_P, _T]) -> Callable[_P, _T]:
    """Return a method that raises `SinkError` for SQLite's errors, and `FullError` if the disk does
    not take bytes.
    """

    @wraps(method)
    def wrapped(*args: _P.args, **kwargs: _P.kwargs) -> _T:
        try:
            return method(*args, **kwargs)
        except sqlite3.Error as error:
            journal: Any = args[0]
            journal.end_transaction()
            if is_refusal(error) or (journal.is_open and primary_code(error) == "SQLITE_CORRUPT"):
                raise FullError(_why(error)) from error
            raise complaint(journal.path, error) from error

    return wrapped


class Journal:
    """A `Backlog` in a file, which may hold batches of an earlier run."""

    def __init__(self, path: str, max_bytes: int, *, survives_power_cut: bool = False) -> None:
        self.path = path
        self._max_bytes = max_bytes
        self._bytes = 0
        self.waiting = 0
        self._sync: SyncThread | None = None
        self._files: tuple[NamedFile, ...] = ()
        self._lost = ""
        #: Whether the file was found whole enough to be used. From then on SQLite's "malformed" may
        #: be an error of a read (its code CORRUPTFS), which passes: the file is judged at the next
        #: start.
        self.is_open = False
        self.is_closed = False
        try:
            absolute = str(Path(path).absolute())  # else ":memory:" would be no file
            self._database = sqlite3.connect(
                absolute, timeout=0.0, isolation_level=None, check_same_thread=False
            )
        except sqlite3.Error as error:
            raise complaint(path, error) from error
        try:
            self._open(survives_power_cut)
            self.is_open = True
            log = Path(f"{absolute}-wal")
            self._files = NamedFile(Path(absolute), sys.maxsize), NamedFile(log, _LOG_BYTES)
            if (
                not survives_power_cut
            ):  # a log has no locks, which closing a descriptor would give up
                self._sync = SyncThread(partial(self._make_last, log), SPOOL_SYNC_S)
        except FullError as error:
            self.close()
            reason = f": {error}" if str(error) else ""
            raise SinkError(f"the spool {path} cannot be written{reason}; {_ROOM}") from error
        except BaseException:
            self.close()
            raise

    @_raises_ours
    def put(self, batch: Batch) -> None:
        """Add a batch; raise `FullError` if there is no room for it in the file or on the disk."""
        row = _row_of(batch)
        self._files_fault()
        if self._bytes and self._bytes + row[1] > self._max_bytes:
            raise FullError
        self._database.execute(_INSERT, row)
        self._bytes += row[1]
        self.waiting += batch.events
        self._files_fault()  # how long they are now
        if self._sync is not None:
            self._sync.note_write()

    @property
    def is_empty(self) -> bool:
        """Whether no batch waits."""
        return not self._bytes

    @property
    def outlives_the_process(self) -> bool:
        """Whether the file keeps what waits: not once it, or its log, was removed or cut off."""
        return not self._files_fault()

    @property
    def sync_fault(self) -> str:
        """Why the disk did not make the log last, or ""."""
        return self._files_fault() or ("" if self._sync is None else self._sync.fault)

    def _make_last(self, log: Path) -> None:
        if not self._files_fault():
            sync_path(log)

    def _files_fault(self) -> str:
        """Return what became of the file or of its log, "" if nothing did.

        What was once cut off or gone for a while may lack what was written meanwhile, so that a
        fault stays.
        """
        if not self._lost and not self.is_closed:
            faults = (file.fault() for file in self._files)
            self._lost = next((f"the file or its log: {fault}" for fault in faults if fault), "")
        return self._lost

    @_raises_ours
    def after(self, number: int) -> tuple[int, Batch] | None:
        """Return the first batch with a higher number, with its number, or None; raise
        `DamagedError` if it is damaged.

        Raises `FullError` if the disk does not let it be read.
        """
        row = self._database.execute(_NEXT, (number,)).fetchone()
        if row is None:
            return None
        batch = batch_of(row)
        if batch is None:
            words = f"batch {row[0]} with {row[1]} events is not what was written, and is not sent"
            raise DamagedError(
                row[0],
                f"the spool {self.path} is damaged: {words}; the next start sets the file aside",
            )
        return row[0], batch

    @_raises_ours
    def acknowledge(self, numbers: Iterable[int]) -> None:
        """Remove the batches with these numbers, all or none."""
        self._files_fault()  # before the log grows, which would fill what was cut off
        self._files_fault()  # before the log grows, which would fill what was cut off
        events = 0
        cost = 0
        self._database.execute("BEGIN")
        for number in numbers:
            row = self._database.execute(
                "DELETE FROM parcel WHERE number = ? RETURNING events, bytes", (number,)
            )
            ((row_events, row_bytes),) = row.fetchall()
            events = events + row_events
            cost = cost + row_bytes
        self._database.execute("COMMIT")
        self.waiting -= events
        self._bytes -= cost

    @_raises_ours
    def keep(self, number: int, rows: Sequence[int]) -> None:
        """Remove the events of a batch but those in `rows`."""
        self._files_fault()
        row = self._database.execute(_NEXT, (number - 1,)).fetchone()
        if row[0] == number and (batch := batch_of(row)):
            remaining_row = _row_of(batch.take(rows))
            self._database.execute(_REPLACE, (*remaining_row, number))
            self.waiting -= row[1] - remaining_row[0]
            self._bytes -= row[2] - remaining_row[1]

    @_raises_ours
    def drop_oldest(self, number: int) -> int | None:
        """Remove the first batch with a higher number and return its number of events; None if
        there is none.
        """
        row = self._database.execute(
            "SELECT min(number) FROM parcel WHERE number > ?", (number,)
        ).fetchone()
        if row[0] is None:
            return None
        former_waiting = self.waiting
        self.acknowledge([row[0]])
        return former_waiting - self.waiting

    def end_transaction(self) -> None:
        """Undo what an error has left open."""
        with suppress(sqlite3.Error):
            if self._database.in_transaction:
                self._database.execute("ROLLBACK")

    def close(self) -> None:
        """Close the file; SQLite merges its log if there is room, else at the next opening."""
        self._files_fault()
        if self._sync is not None:
            self._sync.stop()
        self.is_closed = True
        with suppress(sqlite3.Error):
            self._database.close()

    @_raises_ours
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
            answer = execute(f"PRAGMA {pragma}").fetchall()
            if pragma == "journal_mode = WAL" and answer != [("wal",)]:
                raise SinkError(
                    f"the spool {self.path} is on a disk that cannot hold one; give a path on"
                    f" another disk"
                )
        execute("BEGIN EXCLUSIVE")
        self._require_spool()
        execute(_TABLE)
        execute("COMMIT")
        with suppress(
            sqlite3.Error
        ):  # the mark of a spool is looked for in the file itself; a full disk has none
            execute("PRAGMA wal_checkpoint")
        execute(f"PRAGMA max_page_count = {pages}")
        self.waiting, self._bytes = execute(
            "SELECT total(events), total(bytes) FROM parcel"
        ).fetchone()
        self.waiting = int(self.waiting)
        self._bytes = int(self._bytes)
        with suppress(OSError):  # SQLite does not sync the name of a new file
            sync_path(Path(self.path).absolute().parent)

    def _require_spool(self) -> None:
        """Mark a new database as a spool; raise `SinkError` for any other database."""
        execute = self._database.execute
        (application,), (version,) = (
            execute(f"PRAGMA {pragma}").fetchone() for pragma in ("application_id", "user_version")
        )
        tables = execute("SELECT count(*) FROM sqlite_master").fetchone()[0]
        if not tables and not application:
            execute(f"PRAGMA application_id = {_APPLICATION}")
            execute(f"PRAGMA user_version = {_VERSION}")
        elif application != _APPLICATION:
            raise SinkError(
                f"{self.path} is a database of something else, not a spool; give the spool another"
                f" path"
            )
        elif version != _VERSION:
            raise SinkError(
                f"the spool {self.path} has version {version}, and this opir reads {_VERSION};"
                f" {_MOVE}"
            )


def _row_of(batch: Batch) -> tuple[Any, ...]:
    """Return the columns of a batch but its number; the second is an upper bound of the bytes that
    they take.
    """
    key_of = batch.key_of.astype("<u2").tobytes()
    # A small row may leave as much of its page empty as it fills.
    content = (
        len(batch.body) + 2 * len(batch) + sum(6 * len(key) + 4 for key in batch.keys) + _ROW_BYTES
    )
    kind = (batch.content_type, batch.schema_version, json.dumps(batch.keys))
    cost = content + min(content, 2 * _PAGE_BYTES)
    return batch.events, cost, _checksum(*kind, key_of, batch.body), *kind, key_of, batch.body


def batch_of(row: tuple[Any, ...]) -> Batch | None:
    """Return the batch of a row of the table, with all its columns; None if it is not what was
    written.
    """
    _number, events, _bytes, crc, content_type, schema_version, keys, key_of, body = row
    try:
        if _checksum(content_type, schema_version, keys, key_of, body) != crc:
            return None
    except (AttributeError, TypeError):  # damage can change a column's type
        return None
    batch = Batch(
        body=body,
        keys=tuple(json.loads(keys)),
        key_of=np.frombuffer(key_of, dtype="<u2").astype(np.uint16),
        content_type=content_type,
        schema_version=schema_version,
    )
    return batch if batch.events == events else None


def is_spool_file(path: Path) -> bool:
    """Return whether a file has the mark of a spool of this version in its header
    (sqlite.org/fileformat2.html).
    """
    with path.open("rb") as file:
        header = file.read(100)
    return header[68:72] == _APPLICATION.to_bytes(4, "big") and header[60:64] == _VERSION.to_bytes(
        4, "big"
    )


_MOVE = "move it away, and a new one is made"
_ROOM = "make room, or give a path on another disk"

#: What a disk answers that is full, over a quota or a limit, failing, or mounted anew to be read
#: only.
_REFUSALS_OF_THE_DISK = frozenset({"SQLITE_FULL", "SQLITE_IOERR", "SQLITE_READONLY"})

_WORDS = {
    "SQLITE_BUSY": "is in use by another process; stop that, or give each output a spool of its"
    " own",
    "SQLITE_LOCKED": "is in use by another process; stop that, or give each output a spool of its"
    " own",
    "SQLITE_NOTADB": f"is not a spool, or damaged; {_MOVE}",
    "SQLITE_CORRUPT": f"is damaged; {_MOVE}",
    "SQLITE_CANTOPEN": "cannot be opened; give a path, in a folder that exists, that may be"
    " written",
    "SQLITE_READONLY": "may not be written; give a path that may",
    "SQLITE_PERM": "may not be written; give a path that may",
    "SQLITE_IOERR": "cannot be read or written: its disk fails; give a path on another disk",
    "SQLITE_FULL": "has no room on its disk; make room, or give a path on another disk",
}


def complaint(path: str, error: sqlite3.Error) -> SinkError:
    """Return the `SinkError` for an error of SQLite."""
    folder = Path(path).parent
    if primary_code(error) == "SQLITE_CANTOPEN" and not folder.is_dir():
        return SinkError(
            f"the spool {path} cannot be made: there is no folder {str(folder)!r}; make it"
        )
    words = _WORDS.get(primary_code(error), f"cannot be used ({error}); give it another path")
    return SinkError(f"the spool {path} {words}")


def _why(error: sqlite3.Error) -> str:
    """Return why the disk does not take bytes: nothing for a full one, which `FullError` says."""
    return (
        "" if primary_code(error) == "SQLITE_FULL" else f"its disk answers {str(error).lower()!r}"
    )


def is_refusal(error: sqlite3.Error) -> bool:
    """Return whether the disk refused an operation, which says nothing about the file."""
    return primary_code(error) in _REFUSALS_OF_THE_DISK


def primary_code(error: sqlite3.Error) -> str:
    """Return SQLite's primary error code; extended codes begin with it
    (https://www.sqlite.org/rescode.html).
    """
    name: Any = getattr(error, "sqlite_errorname", "") or ""
    return "_".join(name.split("_")[:2])


def _checksum(*contents: str | bytes) -> int:
    crc = 0
    for content in contents:
        crc = crc32(
            content if isinstance(content, bytes) else content.encode("utf-8", "surrogatepass"), crc
        )
    return crc
