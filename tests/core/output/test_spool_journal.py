"""The file of a spool: other files are refused and left unchanged, damage is reported, and its
owner is recorded.
"""

import errno
import random
import shutil
import sqlite3
import threading
import time
from concurrent.futures import Future
from pathlib import Path

import numpy as np
import pytest
from failing_disk import FailingDisk, can_fail
from spool_transports import (
    ENCODER,
    MIB,
    ORIGIN,
    QUICK,
    SENSORS,
    Holding,
    ids_of,
    spooled,
    window,
)
from waiting import until

from opir_core.builtin.sinks import MemorySink
from opir_core.errors import SinkError
from opir_core.output import spool_state
from opir_core.output.spool import (
    EncodedBatcher,
    Journal,
    TransportSink,
    WindowBatcher,
    WindowTransport,
)
from opir_core.plugin import Batch


@pytest.mark.skipif(not Path("/dev/full").exists(), reason="this system has no /dev/full")
@pytest.mark.parametrize("place", ["/dev/full", "/dev/null"])
def test_a_device_is_no_spool(place: str) -> None:
    with pytest.raises(SinkError, match=f"the spool {place} "):
        Journal(place, MIB)


def test_a_spool_in_use_is_refused(tmp_path: Path) -> None:
    first_sink = spooled(tmp_path / "spool", Holding())
    with pytest.raises(
        SinkError, match=r"the spool .* is in use by another process; stop that, or give"
    ):
        Journal(str(tmp_path / "spool"), MIB)
    first_sink.close()
    Journal(str(tmp_path / "spool"), MIB).close()


def test_a_file_other_than_a_database_is_refused(tmp_path: Path) -> None:
    path = tmp_path / "spool"
    path.write_bytes(b"not a spool" * 1000)
    with pytest.raises(SinkError, match="is not a spool, or damaged; move it away"):
        Journal(str(path), MIB)
    assert path.read_bytes() == b"not a spool" * 1000


def test_a_database_of_something_else_is_refused(tmp_path: Path) -> None:
    path = tmp_path / "spool"
    with sqlite3.connect(path) as database:
        database.execute("CREATE TABLE other (x)")
    database.close()
    with pytest.raises(SinkError, match="is a database of something else"):
        Journal(str(path), MIB)


def test_a_spool_of_another_version_is_refused(tmp_path: Path) -> None:
    path = tmp_path / "spool"
    Journal(str(path), MIB).close()
    with sqlite3.connect(path) as database:
        database.execute("PRAGMA user_version = 9")
    database.close()
    with pytest.raises(SinkError, match="has version 9, and this opir reads 1"):
        Journal(str(path), MIB)


def test_errors_that_room_does_not_mend_are_reported(tmp_path: Path) -> None:
    journal = Journal(str(tmp_path / "spool"), MIB)
    journal.close()
    with pytest.raises(SinkError, match=r"the spool .*closed"):
        journal.after(0)


def test_a_missing_folder_is_reported(tmp_path: Path) -> None:
    with pytest.raises(SinkError, match="there is no folder"):
        Journal(str(tmp_path / "missing" / "spool"), MIB)
    with pytest.raises(SinkError, match="cannot be opened"):
        Journal(str(tmp_path), MIB)


@pytest.mark.slow
@pytest.mark.parametrize("seed", range(12))
def test_damage_is_reported_or_harmless_and_never_sent(tmp_path: Path, seed: int) -> None:
    path = tmp_path / "spool"
    journal = Journal(str(path), 64 * MIB)
    for number in range(4):
        journal.put(next(EncodedBatcher(ENCODER, SENSORS).batches(window(200, 200 * number))))
    journal.close()
    damaged = bytearray(path.read_bytes())
    rng = random.Random(seed)
    for _ in range(8):
        damaged[rng.randrange(len(damaged))] ^= 1 << rng.randrange(8)
    path.write_bytes(damaged)
    all_ids = set(ids_of(window(800)))
    carrier = Holding()
    try:
        sink = spooled(path, carrier, QUICK)
    except SinkError as error:
        assert str(error).startswith(("the spool ", str(path)))  # noqa: PT017
    else:
        reported = sink.close()
        assert set(carrier.ids) <= all_ids
        assert reported.complaint is not None or reported.delivered == 800


def test_a_spool_of_another_output_is_reported(tmp_path: Path) -> None:
    first_sink = spooled(tmp_path / "spool", Holding("hold"))
    first_sink.write(window(5))
    first_sink.close()
    memory_sink = MemorySink(lambda: ENCODER)
    second = TransportSink(
        "memory",
        WindowTransport(memory_sink, ORIGIN),
        Journal(str(tmp_path / "spool"), MIB),
        WindowBatcher(ENCODER, ORIGIN),
        QUICK,
    )
    reported = second.close()
    assert reported.spooled == 5
    assert reported.complaint is not None
    assert "give each output a spool of its own" in reported.complaint


def test_the_rest_of_a_batch_is_what_is_left_of_it(tmp_path: Path) -> None:
    key_of = np.array([0, 1, 0, 1], dtype=np.uint16)
    first_batch = Batch(
        body=b"a\nb\nc\nd\n",
        keys=("x", "y"),
        key_of=key_of,
        content_type="text",
        schema_version="1",
    )
    journal = Journal(str(tmp_path / "spool"), 1 << 20)
    journal.put(first_batch)
    journal.put(first_batch)
    journal.keep(1, [1, 2])
    assert journal.waiting == 6
    journal.close()
    reopened = Journal(str(tmp_path / "spool"), 1 << 20)
    assert reopened.waiting == 6
    number, batch_left = reopened.after(0) or (0, first_batch)
    assert (number, batch_left.messages(), batch_left.key_of.tolist()) == (1, [b"b", b"c"], [1, 0])
    reopened.close()


@pytest.mark.skipif(not can_fail(), reason="needs a SQLite whose calls can be seen")
def test_the_log_is_synced_within_a_second(tmp_path: Path) -> None:
    with FailingDisk(tmp_path) as disk:
        sink = spooled(tmp_path / "spool", Holding())
        sink.write(window(5))
        call_count = len(disk.calls)
        until(lambda: ("fsync", "spool-wal") in disk.calls[call_count:], within_s=10.0)
        synced = disk.calls.count(("fsync", "spool-wal"))
        time.sleep(1.5)
        assert disk.calls.count(("fsync", "spool-wal")) == synced  # nothing new: nothing to sync
        for _ in range(30):
            sink.write(window(5))
            time.sleep(0.05)
        assert disk.calls.count(("fsync", "spool-wal")) > synced
        disk.fail_at(1, errno.EIO, lasts=True, kinds=("fsync",))
        sink.write(window(5))
        until(lambda: "cannot be written" in (sink.parked or ""), within_s=10.0)
        disk.heal()
        until(lambda: sink.parked is None, within_s=10.0)
        sink.close()


class Stuck(Holding):
    """A carrier whose `send` does not return until it is let go."""

    def __init__(self) -> None:
        super().__init__()
        self.let_go = threading.Event()

    def send(self, batch: Batch) -> "Future[None]":
        self.let_go.wait(30.0)
        return super().send(batch)


@pytest.mark.skipif(not can_fail(), reason="needs a SQLite whose calls can be seen")
def test_the_log_is_synced_while_a_transport_hangs(tmp_path: Path) -> None:
    carrier = Stuck()
    with FailingDisk(tmp_path) as disk:
        sink = spooled(tmp_path / "spool", carrier)
        sink.write(window(5))
        time.sleep(0.3)
        call_count = len(disk.calls)
        sink.write(window(5, 5))
        until(lambda: ("fsync", "spool-wal") in disk.calls[call_count:], within_s=2.0)
        carrier.let_go.set()
        assert sink.close().delivered == 10


def test_a_spool_that_was_killed_when_it_was_new_is_a_spool(tmp_path: Path) -> None:
    sink = spooled(tmp_path / "spool", Holding("hold"))
    sink.write(window(5))
    (tmp_path / "killed").mkdir()
    for path in tmp_path.glob("spool*"):
        shutil.copy(path, tmp_path / "killed")
    sink.close()
    assert spool_state(tmp_path / "killed" / "spool").events == 5
