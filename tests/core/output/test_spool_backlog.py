"""A backlog has a bound: what becomes of events beyond it is chosen, and counted."""

from pathlib import Path

import pytest
from spool_transports import (
    ENCODER,
    MIB,
    PATIENT,
    SENSORS,
    Appending,
    Holding,
    ids_of,
    overfill,
    small,
    window,
)

from opir_core.errors import SinkError
from opir_core.output.spool import EncodedBatcher, FullError, Journal, TransportSink
from opir_core.plugin import Batch, Delivery


@pytest.mark.slow
@pytest.mark.parametrize("is_spooled", [True, False])
def test_a_full_backlog_refuses(tmp_path: Path, is_spooled: bool) -> None:
    sink = small(tmp_path, Holding("hold"), "refuse", is_spooled=is_spooled)
    with pytest.raises(
        SinkError, match=r"stub: its (spool .*|queue) is full, with \d+ events that wait"
    ):
        overfill(sink)
    reported = sink.close()
    assert (reported.spooled > 1000) is is_spooled
    assert reported.spooled + reported.dropped > 1000


@pytest.mark.slow
@pytest.mark.parametrize("is_spooled", [True, False])
def test_a_full_backlog_drops_the_newest_and_counts(tmp_path: Path, is_spooled: bool) -> None:
    carrier = Holding("hold")
    sink = small(tmp_path, carrier, "drop-newest", is_spooled=is_spooled)
    events = overfill(sink)
    carrier.release()
    reported = sink.close()
    assert reported.dropped > 1000
    assert reported.delivered + reported.dropped == events
    assert carrier.ids == ids_of(window(events))[: reported.delivered]


@pytest.mark.slow
@pytest.mark.parametrize("is_spooled", [True, False])
def test_a_full_backlog_drops_the_oldest_unsent_batch(tmp_path: Path, is_spooled: bool) -> None:
    carrier = Holding("hold")
    sink = small(tmp_path, carrier, "drop-oldest", is_spooled=is_spooled)
    events = overfill(sink)
    carrier.release()
    reported = sink.close()
    assert reported.dropped > 1000
    assert reported.delivered + reported.dropped == events
    everything = ids_of(window(events))
    assert carrier.ids[-1] == everything[-1]
    place = {event_id: number for number, event_id in enumerate(everything)}
    assert carrier.ids == sorted(carrier.ids, key=place.__getitem__)


@pytest.mark.slow
@pytest.mark.parametrize("is_spooled", [True, False])
def test_a_full_backlog_waits_for_room(tmp_path: Path, is_spooled: bool) -> None:
    carrier = Appending(tmp_path / "arrived", 0.002)
    sink = small(tmp_path, carrier, "wait", is_spooled=is_spooled, wait_s=20.0)
    events = overfill(sink)
    assert sink.close() == Delivery(delivered=events)
    assert (tmp_path / "arrived").read_bytes() == ENCODER.encode(window(events))


@pytest.mark.slow
def test_waiting_for_room_has_an_end(tmp_path: Path) -> None:
    sink = small(tmp_path, Holding("hold"), "wait", is_spooled=True)
    with pytest.raises(SinkError, match="is full"):
        overfill(sink)
    sink.close()


def test_the_file_stays_within_its_bound(tmp_path: Path) -> None:
    path = tmp_path / "spool"
    journal = Journal(str(path), 2 * MIB)
    parcel = next(EncodedBatcher(ENCODER, SENSORS).batches(window(300)))
    tiny = next(EncodedBatcher(ENCODER, SENSORS).batches(window(1)))
    for batch in (parcel, tiny):
        with pytest.raises(FullError):
            put_for_ever(journal, batch)
        assert path.stat().st_size < 2.2 * MIB
        assert (tmp_path / "spool-wal").stat().st_size < 6 * MIB
    numbers = iter(lambda: journal.drop_oldest(0), None)
    assert sum(numbers) > 1000
    journal.put(parcel)
    journal.close()
    assert path.stat().st_size < 2.2 * MIB


def test_a_disk_without_room_is_a_full_spool(tmp_path: Path) -> None:
    """SQLite's own bound on pages stands for the disk's: both are reported as SQLITE_FULL."""
    journal = Journal(str(tmp_path / "spool"), 1 << 40)
    pages = journal._database.execute("PRAGMA page_count").fetchone()[0]
    journal._database.execute(f"PRAGMA max_page_count = {pages + 400}")
    carrier = Holding("hold")
    sink = TransportSink("stub", carrier, journal, EncodedBatcher(ENCODER, SENSORS), PATIENT)
    with pytest.raises(SinkError, match="is full"):
        overfill(sink)
    carrier.release()
    reported = sink.close()
    assert reported.delivered > 1000
    assert carrier.ids == ids_of(window(reported.delivered))


def put_for_ever(journal: Journal, parcel: Batch) -> None:
    while True:
        journal.put(parcel)
