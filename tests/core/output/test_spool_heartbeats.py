"""Heartbeats among the messages of a transport: in order, in the spool, and in no book."""

import json
from pathlib import Path
from typing import Any

import pytest
from attrs import evolve
from spool_transports import ENCODER, MIB, SENSORS, Holding, policy_for, unspooled, window

from opir_core.interfaces.outputs import Delivery
from opir_core.interfaces.records import CommandRecord
from opir_core.output.heartbeats import Heartbeats
from opir_core.output.spool.batches import EncodedBatcher, MemoryBacklog
from opir_core.output.spool.journal import Journal
from opir_core.output.spool.policy import Policy
from opir_core.output.spool.salvage import spool_state
from opir_core.output.spool.transport_sink import TransportSink

#: A window without events.
QUIET = evolve(window(0), end_s=3.0)


def beating(carrier: Holding, backlog: Any, policy: Policy | None = None) -> TransportSink:
    """Return a sink with a heartbeat of each sensor and second."""
    beats = Heartbeats(SENSORS, 0, 1.0)
    batcher = EncodedBatcher(ENCODER, SENSORS, beats)
    return TransportSink("stub", carrier, backlog, batcher, policy or policy_for(carrier))


def records(carrier: Holding) -> list[str]:
    return [event.get("record", "event") for event in carrier.events]


def test_heartbeats_follow_the_events_of_their_window_and_are_not_counted() -> None:
    carrier = Holding()
    sink = beating(carrier, MemoryBacklog(MIB))
    assert sink.takes_quiet_windows
    assert not unspooled(Holding()).takes_quiet_windows
    full_window = window(20)
    sink.write(full_window)
    count = round(full_window.end_s // 1.0)
    assert sink.close() == Delivery(delivered=20)
    assert records(carrier)[:20] == ["event"] * 20
    assert records(carrier)[20:] == ["heartbeat"] * 5 * (count + (full_window.end_s % 1.0 > 0.0))
    beats = [parcel for parcel in carrier.parcels if parcel.schema_version == "heartbeat-1.0"]
    for parcel in beats:
        keys = [parcel.keys[key] for key in parcel.key_of]
        assert keys == [json.loads(line)["sensor_id"] for line in parcel.messages()]
        assert parcel.content_type == "application/json"
        assert parcel.events == 0
        assert len(parcel) == len(parcel.messages()) > 0


def test_the_lines_are_those_of_a_file() -> None:
    carrier = Holding()
    sink = beating(carrier, MemoryBacklog(MIB))
    sink.write(window(20))
    sink.close()
    file = Heartbeats(SENSORS, 0, 1.0)
    lines = file.until(window(20).end_s) + file.rest()
    sent = [parcel.body for parcel in carrier.parcels if not parcel.events]
    assert b"".join(sent) == lines


def test_a_sensor_that_leaves_its_survey_does_not_watch() -> None:
    wide = evolve(SENSORS[0], modes={"sector": SENSORS[0]})
    turn = CommandRecord(0.2, wide.id, -1, "", start_s=0.3, from_s=0.4, mode="sector")
    batcher = EncodedBatcher(ENCODER, SENSORS, Heartbeats([wide], 0, 1.0))
    (batch,) = batcher.batches(evolve(QUIET, commands=(turn,)))
    ends = [json.loads(line)["watched_to"] for line in batch.body.splitlines()]
    assert ends[0] == "1970-01-01T00:00:00.300000Z"


@pytest.mark.parametrize("mood", ["hold", "fail"])
def test_a_spool_keeps_heartbeats_for_the_next_run(tmp_path: Path, mood: str) -> None:
    path = tmp_path / "spool"
    first_sink = beating(Holding(mood), Journal(str(path), MIB))
    first_sink.write(window(20))
    counts = first_sink.close()
    assert (counts.delivered, counts.spooled, counts.dropped) == (0, 20, 0)
    state = spool_state(path)
    assert (state.is_whole, state.events) == (True, 20)
    carrier = Holding()
    second = beating(carrier, Journal(str(path), MIB))
    assert second.close() == Delivery(delivered=20, recovered=20)
    assert records(carrier)[:20] == ["event"] * 20
    assert set(records(carrier)[20:]) == {"heartbeat"}
    assert spool_state(path).batches == 0


def test_heartbeats_alone_are_sent_before_the_sink_is_closed(tmp_path: Path) -> None:
    for backlog in (MemoryBacklog(MIB), Journal(str(tmp_path / "spool"), MIB)):
        carrier = Holding()
        sink = beating(carrier, backlog)
        sink.write(QUIET)
        assert sink.close() == Delivery(delivered=0)
        assert set(records(carrier)) == {"heartbeat"}


def test_a_spool_of_heartbeats_alone_is_sent_by_the_next_run(tmp_path: Path) -> None:
    path = tmp_path / "spool"
    first_sink = beating(Holding("hold"), Journal(str(path), MIB))
    first_sink.write(QUIET)
    assert first_sink.close() == Delivery(delivered=0)
    carrier = Holding()
    assert beating(carrier, Journal(str(path), MIB)).close() == Delivery(delivered=0)
    assert set(records(carrier)) == {"heartbeat"}


@pytest.mark.parametrize("when_full", ["drop-oldest", "drop-newest"])
@pytest.mark.parametrize("is_spooled", [True, False])
def test_the_books_are_exact_where_messages_are_dropped(
    tmp_path: Path, when_full: str, is_spooled: bool
) -> None:
    size = MIB // 8
    backlog = Journal(str(tmp_path / "spool"), size) if is_spooled else MemoryBacklog(size)
    carrier = Holding("hold")
    sink = beating(carrier, backlog, Policy(when_full=when_full, wait_s=0.1, stall_s=0.2))
    for number in range(30):
        sink.write(window(40, 40 * number))
        counts = sink.delivery_so_far()
        assert counts.delivered + counts.spooled + counts.dropped == 40 * (number + 1)
    assert counts.dropped > 0
    counts = sink.close()
    assert counts.spooled + counts.dropped == 1200


def test_a_damaged_row_of_events_is_not_taken_for_heartbeats(tmp_path: Path) -> None:
    import sqlite3

    path = tmp_path / "spool"
    sink = beating(Holding("hold"), Journal(str(path), MIB))
    sink.write(window(20))
    sink.close()
    with sqlite3.connect(path) as database:
        database.execute("UPDATE parcel SET events = 0")
    database.close()
    assert spool_state(path).damaged == (1,)
