"""Damaged spools: which batches of one are whole, and a new spool made of these.

A batch is whole if its row can be read and has its checksum. The damaged file is set aside, not
changed.
"""

import logging
import sqlite3
from collections.abc import Iterator
from contextlib import closing, suppress
from pathlib import Path

from attrs import evolve, field, frozen

from opir_core.errors import SinkError, reason_of
from opir_core.interfaces.records import Batch
from opir_core.output.spool.batches import FullError
from opir_core.output.spool.journal import (
    Journal,
    batch_of,
    complaint,
    is_refusal,
    is_spool_file,
    primary_code,
)
from opir_core.output.temporary_files import sync_path

#: Appended to the path of a spool that is made from a damaged one, until it is complete, and until
#: it is in place.
_NEW = ".salvaging"
_READY = ".salvaged"
_ROW = (
    "SELECT number, events, bytes, crc, content_type, schema_version, keys, key_of, body FROM"
    " parcel WHERE number = ?"
)
_BIGGEST = 1 << 50
_CHUNK = 1 << 20
#: SQLite's codes that are neither damage nor a refusal of the disk.
_NO_DAMAGE = frozenset(
    {"SQLITE_BUSY", "SQLITE_LOCKED", "SQLITE_CANTOPEN", "SQLITE_PERM", "SQLITE_NOMEM"}
)

_log = logging.getLogger(__name__)

#: What SQLite raises at a damaged file: at damaged names it fails to say which.
_DAMAGE = (sqlite3.DatabaseError, UnicodeDecodeError)


@frozen
class SpoolState:
    """The batches of a spool that are whole, their events, and the numbers of those that are
    damaged.

    `lost_events` are of the damaged batches, as far as their number can still be read.
    `is_readable` is false if the file itself is damaged where SQLite needs it to read, `is_sound`
    where it needs it to write.
    """

    batches: int
    events: int
    damaged: tuple[int, ...] = ()
    lost_events: int = 0
    is_readable: bool = True
    is_sound: bool = True

    @property
    def is_whole(self) -> bool:
        """Whether nothing is damaged."""
        return self.is_readable and self.is_sound and not self.damaged


@frozen
class Salvage:
    """What became of a damaged spool: where it lies, and what its successor holds."""

    aside: Path
    state: SpoolState = field()

    def __str__(self) -> str:
        """Return one line."""
        lost = (
            f"{len(self.state.damaged)} batches with at least {self.state.lost_events} events are"
            f" lost"
        )
        if not self.state.is_readable:
            lost = "nothing else of it can be read"
        return (
            f"it was damaged: {self.state.events} events are salvaged, {lost}; the damaged file is"
            f" {self.aside}"
        )


def spool_state(path: str | Path) -> SpoolState:
    """Return the undamaged batches of a spool; `SinkError` if the file is missing, in use,
    unreadable or not a spool.
    """
    place = _existing(Path(path))
    with closing(_opened(place)) as database:
        state = evolve(
            _counted(list(_batches(database, place, keep=False))),
            is_sound=_is_sound(database, place),
        )
    if not state.is_whole:
        _require_readable(place)
    return state


def salvage(path: str | Path) -> Salvage | None:
    """Replace a damaged spool by one of its whole batches; None if it is whole. Raises `SinkError`.

    The new spool is complete before the damaged one is set aside: a process that is killed
    meanwhile loses nothing.
    """
    place = _existing(Path(path))
    state = spool_state(place)
    if state.is_whole:
        return None
    try:
        _make_successor(place)
        aside = _put_in_place(place)
    except (FullError, OSError) as error:
        reason = (
            reason_of(error) if isinstance(error, OSError) else str(error) or "its disk is full"
        )
        raise SinkError(
            f"the damaged spool {place} cannot be salvaged: {reason}; make room on its disk"
        ) from error
    done = Salvage(aside, state)
    _log.warning("the spool %s: %s", place, done)
    return done


def _make_successor(place: Path) -> None:
    """Make a spool of the whole batches of a damaged one; once it is complete, it has the name of a
    ready one.
    """
    successor = _beside(place, _NEW)
    _remove(successor)
    journal = Journal(str(successor), _BIGGEST, survives_power_cut=True)
    try:
        with closing(_opened(place)) as database:
            for _number, batch, _events in _batches(database, place, keep=True):
                if isinstance(batch, Batch):
                    journal.put(batch)
    finally:
        journal.close()
    if _beside(successor, "-wal").exists():  # SQLite could not merge its log
        raise FullError
    successor.rename(_beside(place, _READY))
    sync_path(place.parent)


def _put_in_place(place: Path) -> Path:
    """Set the damaged spool, or what is left of it, aside, and give its successor its name; return
    the former's.
    """
    aside = _set_aside(place)
    sync_path(
        place.parent
    )  # else a power cut could leave the old log beside the new spool, which would read it
    _beside(place, _READY).rename(place)
    sync_path(place.parent)
    return aside


def salvaged_at_start(path: str | Path) -> Salvage | None:
    """Salvage the spool of an output before it is opened, if there is one and it is damaged."""
    place = Path(path)
    finish_salvage(place)
    return salvage(place) if place.is_file() and is_spool_file(place) else None


def finish_salvage(path: Path) -> None:
    """Put a spool in place that was ready when the process was killed; raises `SinkError`."""
    if _beside(path, _READY).is_file() and not _beside(path, _READY).is_symlink():
        try:
            _put_in_place(path)
        except OSError as error:
            raise SinkError(
                f"the salvaged spool {path} cannot be put in place: {reason_of(error)}"
            ) from error


def _counted(rows: list[tuple[int, Batch | bool, int]]) -> SpoolState:
    readable = [events for _number, batch, events in rows if batch]
    damaged = [(number, events) for number, batch, events in rows if not batch]
    is_readable = not any(number < 0 for number, _ in damaged)
    return SpoolState(
        batches=len(readable),
        events=sum(readable),
        damaged=tuple(number for number, _ in damaged if number >= 0),
        lost_events=sum(events for _, events in damaged),
        is_readable=is_readable,
    )


def _batches(
    database: sqlite3.Connection, path: Path, *, keep: bool
) -> Iterator[tuple[int, Batch | bool, int]]:
    """Yield number, batch (or whether it is whole) and events of each row; number -1 if the file
    cannot be read.
    """
    try:
        first_number, last_number = _range(database)
    except _DAMAGE as error:
        _require_damage(path, error)
        yield -1, False, 0
        return
    for number in range(first_number, last_number + 1):
        try:
            row = database.execute(_ROW, (number,)).fetchone()
        except _DAMAGE as error:
            _require_damage(path, error)
            yield number, False, 0
            continue
        if row is not None:
            batch = batch_of(row)
            yield (
                number,
                (batch if keep else True) if batch else False,
                batch.events if batch else _events_claimed(row),
            )


def _is_sound(database: sqlite3.Connection, path: Path) -> bool:
    """Return whether SQLite finds the file's pages in order: damage of free pages hinders only
    writing.
    """
    try:
        return bool(database.execute("PRAGMA quick_check(1)").fetchone() == ("ok",))
    except _DAMAGE as error:
        _require_damage(path, error)
        return False


def _range(database: sqlite3.Connection) -> tuple[int, int]:
    """Return the lowest and the highest number that a row may have."""
    database.execute("SELECT number FROM parcel LIMIT 0").fetchall()
    last_number = 0
    for words in (
        "SELECT max(number) FROM parcel",
        "SELECT seq FROM sqlite_sequence WHERE name = 'parcel'",
    ):
        with suppress(*_DAMAGE):
            last_number = max(
                last_number, *(int(row[0] or 0) for row in database.execute(words)), 0
            )
    first_number = 1
    with suppress(*_DAMAGE):
        first_number = int(database.execute("SELECT min(number) FROM parcel").fetchone()[0] or 1)
    return max(1, first_number), last_number


def _events_claimed(row: tuple[object, ...]) -> int:
    """Return the number of events that a damaged row gives, if it can be one."""
    events = row[1]
    return events if isinstance(events, int) and 0 <= events < 1 << 20 else 0


def _opened(path: Path) -> sqlite3.Connection:
    try:
        database = sqlite3.connect(str(path.absolute()), timeout=0.0, isolation_level=None)
        database.text_factory = lambda content: content.decode("utf-8", "replace")
        database.execute("PRAGMA locking_mode = EXCLUSIVE")
        return database
    except sqlite3.Error as error:
        raise complaint(str(path), error) from error


def _require_damage(path: Path, error: Exception) -> None:
    """Raise `SinkError` for an error that says nothing about the file: it is in use, or the disk
    fails.
    """
    if isinstance(error, sqlite3.Error) and (
        is_refusal(error) or primary_code(error) in _NO_DAMAGE
    ):
        raise complaint(str(path), error) from error


def _require_readable(path: Path) -> None:
    """Raise `SinkError` if the disk does not let a spool be read: SQLite calls some errors of reads
    damage.
    """
    for place in (path, _beside(path, "-wal")):
        try:
            with place.open("rb") as file:
                while file.read(_CHUNK):
                    pass
        except FileNotFoundError:
            continue
        except OSError as error:
            way = "copy what can be read to another disk, and salvage the copy"
            raise SinkError(
                f"the spool {path} cannot be read: {reason_of(error)}; {way}"
            ) from error


def _existing(path: Path) -> Path:
    finish_salvage(path)
    if not path.is_file():
        raise SinkError(
            f"there is no spool {path}; give the path of the file that `spool: {{path: ...}}` names"
        )
    if not is_spool_file(path):
        raise SinkError(
            f"{path} is not a spool; give the path of the file that `spool: {{path: ...}}` names"
        )
    return path


def _set_aside(path: Path) -> Path:
    """Rename a spool to the first free name, its log first: a log beside another file would be
    replayed into it.
    """
    number = 1
    while (aside := _beside(path, f".damaged-{number}")).exists():
        number += 1
    for suffix in ("-wal", "-shm", ""):
        with suppress(FileNotFoundError):
            _beside(path, suffix).rename(_beside(aside, suffix))
    return aside


def _remove(path: Path) -> None:
    for suffix in ("-wal", "-shm", ""):
        _beside(path, suffix).unlink(missing_ok=True)


def _beside(path: Path, suffix: str) -> Path:
    return path.with_name(path.name + suffix)
