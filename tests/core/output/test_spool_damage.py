"""Damaged spools are set aside whole, and what is whole of them is sent; a disk that fails follows
`when_full`.
"""

import errno
import random
import resource
import shutil
import signal
import sqlite3
from collections.abc import Iterator
from contextlib import contextmanager, nullcontext
from pathlib import Path
from typing import Any

import pytest
from attrs import evolve
from failing_disk import OPEN, READ, WRITE, WRITING, FailingDisk, can_fail
from spool_transports import (
    ENCODER,
    MIB,
    PATIENT,
    QUICK,
    SENSORS,
    Holding,
    filled_spool,
    flip_body,
    ids_of,
    window,
)
from waiting import until

from opir_core.errors import SinkError
from opir_core.output import salvage, spool_state
from opir_core.output.spool import EncodedBatcher, Journal, Policy, TransportSink, salvaged_at_start

BATCHES = 20
ROWS = 100


@pytest.fixture
def spool(tmp_path: Path) -> Path:
    return filled_spool(tmp_path / "spool", BATCHES, ROWS)


def sent_from(path: Path) -> tuple[Any, list[str]]:
    """Return the counts of a sink that starts with a spool, and the ids that it sends."""
    carrier = Holding()
    damage = salvaged_at_start(path)
    sink = TransportSink(
        "stub",
        carrier,
        Journal(str(path), 64 * MIB),
        EncodedBatcher(ENCODER, SENSORS),
        PATIENT,
        damage,
    )
    return sink.close(), list(carrier.ids)


def test_an_undamaged_spool_is_unchanged(spool: Path) -> None:
    content = spool.read_bytes()
    assert salvage(spool) is None
    state = spool_state(spool)
    assert (state.is_whole, state.batches, state.events) == (True, BATCHES, BATCHES * ROWS)
    assert spool.read_bytes() == content
    assert sorted(path.name for path in spool.parent.iterdir()) == ["spool"]


def test_one_flipped_byte_costs_one_batch_and_no_more(
    spool: Path, caplog: pytest.LogCaptureFixture
) -> None:
    flip_body(spool, 350)
    damaged = spool.read_bytes()
    reported, ids = sent_from(spool)
    all_ids = ids_of(window(BATCHES * ROWS))
    assert ids == all_ids[:300] + all_ids[400:]
    assert (reported.delivered, reported.recovered, reported.dropped, reported.spooled) == (
        1900,
        2000,
        100,
        0,
    )
    assert "1900 events are salvaged, 1 batches with at least 100 events are lost" in (
        reported.complaint or ""
    )
    assert "spool.damaged-1" in caplog.text
    assert (spool.parent / "spool.damaged-1").read_bytes() == damaged
    second_report, ids = sent_from(spool)
    assert (second_report.delivered, second_report.recovered, second_report.complaint, ids) == (
        0,
        0,
        None,
        [],
    )


def test_damage_outside_batches_is_found_before_writing(tmp_path: Path) -> None:
    path = tmp_path / "spool"
    journal = Journal(str(path), 64 * MIB)
    for number in range(BATCHES):
        journal.put(next(EncodedBatcher(ENCODER, SENSORS).batches(window(ROWS, ROWS * number))))
    journal.acknowledge(range(1, 11))
    journal.close()
    content = bytearray(path.read_bytes())
    # Bytes 36 to 39 count the free pages, 32 to 35 name the first:
    # https://www.sqlite.org/fileformat.html
    assert int.from_bytes(content[36:40], "big") > 1
    content[32:36] = b"\x7f\xff\xff\xff"
    path.write_bytes(content)
    state = spool_state(path)
    assert (state.is_whole, state.damaged) == (False, ())
    salvaged = salvaged_at_start(path)
    assert salvaged is not None
    assert (salvaged.state.batches, salvaged.state.is_sound) == (BATCHES - 10, False)
    journal = Journal(str(path), 64 * MIB)
    for number in range(BATCHES):
        journal.put(next(EncodedBatcher(ENCODER, SENSORS).batches(window(ROWS, ROWS * number))))
    journal.close()
    assert spool_state(path).events == (2 * BATCHES - 10) * ROWS


@pytest.mark.slow
@pytest.mark.parametrize(
    "seed", [0, 1, 2, *(pytest.param(seed, marks=pytest.mark.slow) for seed in range(3, 20))]
)
def test_64_flipped_bytes_anywhere_lose_only_what_they_hit(spool: Path, seed: int) -> None:
    content = bytearray(spool.read_bytes())
    rng = random.Random(seed)
    pages = sorted({rng.randrange(len(content)) // 4096 for _ in range(3)} - {0})
    for _ in range(64):
        content[4096 * rng.choice(pages or [1]) + rng.randrange(4096)] ^= 1 << rng.randrange(8)
    spool.write_bytes(content)
    reported, ids = sent_from(spool)
    all_ids = ids_of(window(BATCHES * ROWS))
    assert ids == [event_id for event_id in all_ids if event_id in set(ids)]
    assert reported.delivered == len(ids) == reported.recovered - reported.dropped
    assert reported.delivered == len(all_ids) or reported.complaint is not None
    assert sent_from(spool)[0].complaint is None


@pytest.fixture
def killed(spool: Path) -> Path:
    """Return the spool of a process that was killed: a file and SQLite's log, with 5 batches that
    are only there.
    """
    folder = spool.parent / "killed"
    folder.mkdir()
    journal = Journal(str(spool), 64 * MIB)
    for number in range(BATCHES, BATCHES + 5):
        journal.put(next(EncodedBatcher(ENCODER, SENSORS).batches(window(ROWS, ROWS * number))))
    for name in ("spool", "spool-wal"):
        shutil.copy(spool.parent / name, folder)
    journal.close()
    return folder / "spool"


@contextmanager
def disk_of(spool: Path) -> Iterator[None]:
    """Let nothing be written into a spool's file: its log stays."""
    with FailingDisk(spool.parent) as disk:
        disk.fail_at(1, errno.ENOSPC, lasts=True, kinds=[WRITE], of=lambda name: name == "spool")
        yield


@pytest.mark.slow
@pytest.mark.parametrize(
    ("stopped_at", "is_merged"),
    [
        *((name, True) for name in ("spool.salvaging", "spool", "spool.salvaged")),
        *((name, False) for name in ("spool.salvaging", "spool-wal", "spool", "spool.salvaged")),
    ],
)
def test_a_killed_salvage_is_begun_again_or_finished(
    killed: Path, monkeypatch: pytest.MonkeyPatch, stopped_at: str, is_merged: bool
) -> None:
    """SQLite merges its log into the file when the damaged spool is closed, unless the disk is
    full.
    """
    if not is_merged and not can_fail():
        pytest.skip("needs /proc and SQLite's calls")
    flip_body(killed, 5)
    real = Path.rename

    def stop(self: Path, target: Any) -> Any:
        if self.name == stopped_at:
            raise KeyboardInterrupt
        return real(self, target)

    with monkeypatch.context() as patch:
        patch.setattr(Path, "rename", stop)
        with nullcontext() if is_merged else disk_of(killed), pytest.raises(KeyboardInterrupt):
            salvage(killed)
    reported, ids = sent_from(killed)
    all_ids = ids_of(window((BATCHES + 5) * ROWS))
    assert ids == all_ids[100:]
    assert reported.delivered == 2400


def test_a_spool_in_use_is_not_salvaged(spool: Path) -> None:
    journal = Journal(str(spool), 64 * MIB)
    with pytest.raises(SinkError, match="in use by another process"):
        salvage(spool)
    journal.close()


@contextmanager
def files_of_at_most(size: int) -> Iterator[None]:
    """Let every write beyond a size fail with EFBIG, as it does under a quota."""
    limits = resource.getrlimit(resource.RLIMIT_FSIZE)
    handler = signal.signal(signal.SIGXFSZ, signal.SIG_IGN)
    resource.setrlimit(resource.RLIMIT_FSIZE, (size, limits[1]))
    try:
        yield
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, limits)
        signal.signal(signal.SIGXFSZ, handler)


@pytest.mark.slow
@pytest.mark.parametrize("when_full", ["refuse", "wait", "drop-newest", "drop-oldest"])
def test_a_limited_file_loses_nothing_uncounted(tmp_path: Path, when_full: str) -> None:
    failed = 0
    for limit in range(8192, 400_000, 12_288):
        path = tmp_path / f"spool-{limit}"
        carrier = Holding("hold")
        journal = Journal(str(path), 64 * MIB)
        policy = evolve(QUICK, when_full=when_full, wait_s=0.01)
        sink = TransportSink("stub", carrier, journal, EncodedBatcher(ENCODER, SENSORS), policy)
        event_count = 0
        with files_of_at_most(limit):
            try:
                for number in range(4):
                    event_count += ROWS
                    sink.write(window(ROWS, ROWS * number))
            except SinkError as error:
                failed += 1
                assert "events that wait" in str(error)  # noqa: PT017
        counts = sink.delivery_so_far()
        assert counts.spooled + counts.dropped == event_count
        sink.write(window(ROWS, event_count))  # the limit is lifted
        carrier.release()
        reported = sink.close()
        assert reported.delivered + reported.dropped == event_count + ROWS
        assert set(carrier.ids) >= set(ids_of(window(event_count + ROWS))[event_count:])
        assert reported.delivered == len(set(carrier.ids))
    assert failed > 2 or when_full.startswith("drop")


ERRORS = (
    "SQLITE_IOERR_WRITE",
    "SQLITE_IOERR_FSYNC",
    "SQLITE_FULL",
    "SQLITE_READONLY",
    "SQLITE_IOERR_READ",
)


class Failing:
    """A connection whose n-th statement is answered with an error, before or after it is done."""

    def __init__(self, database: Any, fails_at: int, name: str) -> None:
        self._database = database
        self._fails_at = fails_at
        self._name = name
        self.calls = 0

    def execute(self, *words: Any) -> Any:
        self.calls += 1
        if self.calls == self._fails_at:
            error = sqlite3.OperationalError("disk I/O error")
            error.sqlite_errorname = self._name
            raise error
        return self._database.execute(*words)

    def __getattr__(self, name: str) -> Any:
        return getattr(self._database, name)


@pytest.mark.slow
@pytest.mark.parametrize("name", ERRORS)
def test_whatever_statement_the_disk_fails_nothing_is_lost(tmp_path: Path, name: str) -> None:
    patient = Policy(when_full="wait", wait_s=20.0, stall_s=2.0)
    for number in range(1, 60):
        journal = Journal(str(tmp_path / f"spool-{number}"), 64 * MIB)
        failing = Failing(journal._database, number, name)
        journal._database = failing  # type: ignore[assignment]
        carrier = Holding()
        sink = TransportSink("stub", carrier, journal, EncodedBatcher(ENCODER, SENSORS), patient)
        for place in range(3):
            sink.write(window(ROWS, ROWS * place))
        reported = sink.close()
        remaining_sink = TransportSink(
            "stub",
            carrier,
            Journal(journal.path, 64 * MIB),
            EncodedBatcher(ENCODER, SENSORS),
            patient,
        ).close()
        assert reported.dropped == remaining_sink.dropped == 0
        assert reported.complaint is None
        assert list(dict.fromkeys(carrier.ids)) == ids_of(window(3 * ROWS))
        if failing.calls < number:
            break
    assert number > 6


@pytest.mark.slow
@pytest.mark.skipif(not can_fail(), reason="needs /proc and SQLite's calls")
@pytest.mark.parametrize(
    ("error", "kinds"),
    [(errno.ENOSPC, WRITING), (errno.EIO, (READ,)), (errno.EIO, (OPEN,))],
)
def test_a_spool_on_a_disk_that_fails_is_not_taken_for_damaged(
    killed: Path, error: int, kinds: tuple[str, ...]
) -> None:
    with FailingDisk(killed.parent) as disk:
        for number in range(1, 200):
            disk.fail_at(
                number, error, lasts=True, kinds=kinds, of=lambda name: name.startswith("spool")
            )
            try:
                assert salvaged_at_start(killed) is None
            except (SinkError, OSError) as refused:
                assert str(killed) in str(refused)  # noqa: PT017
                assert isinstance(refused, SinkError)  # noqa: PT017
            assert sorted(path.name for path in killed.parent.glob("*damaged*")) == []
            if disk.failed == 0:
                break
    assert number > 1
    reported, ids = sent_from(killed)
    assert (reported.complaint, ids) == (None, ids_of(window((BATCHES + 5) * ROWS)))


def test_a_batch_damaged_while_waiting_is_left_out(
    tmp_path: Path,
) -> None:
    journal = Journal(str(tmp_path / "spool"), 64 * MIB)
    carrier = Holding()
    for number in range(3):
        journal.put(next(EncodedBatcher(ENCODER, SENSORS).batches(window(ROWS, ROWS * number))))
    journal._database.execute("UPDATE parcel SET body = zeroblob(10) WHERE number = 2")
    # What is damaged is never acknowledged.
    policy = evolve(QUICK, stall_s=2.0)
    sink = TransportSink("stub", carrier, journal, EncodedBatcher(ENCODER, SENSORS), policy)
    sink.write(window(ROWS, 3 * ROWS))
    reported = sink.close()
    all_ids = ids_of(window(4 * ROWS))
    assert carrier.ids == all_ids[:ROWS] + all_ids[2 * ROWS :]
    assert (reported.delivered, reported.spooled, reported.dropped, reported.recovered) == (
        3 * ROWS,
        ROWS,
        0,
        3 * ROWS,
    )
    assert f"batch 2 with {ROWS} events is not what was written, and is not sent" in (
        reported.complaint or ""
    )
    second_report, ids = sent_from(tmp_path / "spool")
    assert (second_report.delivered, second_report.dropped, ids) == (0, ROWS, [])
    assert (tmp_path / "spool.damaged-1").exists()


@pytest.mark.skipif(not can_fail(), reason="needs /proc and SQLite's calls")
def test_a_disk_that_cannot_be_read_is_reported_and_read_again(tmp_path: Path) -> None:
    with FailingDisk(tmp_path) as disk:
        carrier = Holding()
        journal = Journal(str(tmp_path / "spool"), 64 * MIB)
        journal._database.execute("PRAGMA cache_size = 0")  # else the pages are in memory
        journal.put(next(EncodedBatcher(ENCODER, SENSORS).batches(window(1000))))
        disk.fail_at(1, errno.EIO, lasts=True, kinds=[READ])
        sink = TransportSink("stub", carrier, journal, EncodedBatcher(ENCODER, SENSORS), PATIENT)
        until(lambda: sink.parked is not None)
        assert "/spool cannot be read: its disk answers " in (sink.parked or "")
        disk.heal()
        until(lambda: sink.delivery_so_far().delivered == 1000)
        assert sink.parked is None
        assert sink.close().complaint is None
