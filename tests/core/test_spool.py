"""The spool: nothing that was taken is lost, order is kept, what cannot be kept is counted."""

import json
import random
import sqlite3
import threading
import time
from concurrent.futures import Future
from functools import cache
from pathlib import Path
from typing import Any

import pytest
from doomed import killed_at_random
from spool_stand import (
    ENCODER,
    MIB,
    QUICK,
    SENSORS,
    Appending,
    Holding,
    ids_of,
    spooled,
    unspooled,
    window,
)
from waiting import until

from opir_core.builtin.memory import Memory
from opir_core.errors import SinkError
from opir_core.protocols import Delivery
from opir_core.pump import pump
from opir_core.records import Tracks, Window
from opir_core.spool import parcels
from opir_core.spool.backlog import FullError
from opir_core.spool.carriers import Carrier
from opir_core.spool.dispatch import AHEAD_BYTES, Dispatch, Policy
from opir_core.spool.journal import Journal
from opir_core.spool.parcels import PARCEL_EVENTS, Packer
from opir_core.spool.windows import WindowCarrier, WindowPacker
from opir_core.testing.windows import stub_estimates, stub_window


def test_the_stand_keeps_the_protocol() -> None:
    assert isinstance(Holding(), Carrier)


def test_what_a_carrier_acknowledges_is_delivered(tmp_path: Path) -> None:
    carrier = Holding()
    sink = spooled(tmp_path / "spool", carrier)
    windows = [window(3), window(0), window(2500, 3)]
    for each in windows:
        sink.write(each)
    assert sink.close() == Delivery(delivered=2503)
    assert carrier.ids == ids_of(*windows)
    assert carrier.closed == 1


def test_a_parcel_says_whose_each_event_is_and_what_it_is() -> None:
    whole = window(3000)
    packed = list(Packer(ENCODER, SENSORS).parcels(whole))
    assert [len(parcel) for parcel in packed] == [PARCEL_EVENTS, PARCEL_EVENTS, 3000 - 2 * PARCEL_EVENTS]
    assert b"".join(parcel.body for parcel in packed) == ENCODER.encode(whole)
    for parcel in packed:
        keys = [parcel.keys[key] for key in parcel.key_of]
        assert keys == [json.loads(line)["sensor_id"] for line in parcel.messages()]
        assert (parcel.content_type, parcel.schema_version) == ("application/json", "1.0")


def test_what_is_not_acknowledged_is_there_for_the_next_run_and_comes_first(tmp_path: Path) -> None:
    first = spooled(tmp_path / "spool", Holding("hold"))
    first.write(window(1500))
    assert first.close() == Delivery(delivered=0, spooled=1500)
    carrier = Holding()
    second = spooled(tmp_path / "spool", carrier)
    second.write(window(10, 1500))
    assert second.close() == Delivery(delivered=1510, recovered=1500)
    assert carrier.ids == ids_of(window(1510))
    assert spooled(tmp_path / "spool", Holding()).close() == Delivery(delivered=0)


def test_only_what_is_acknowledged_is_struck_off(tmp_path: Path) -> None:
    carrier = Holding("hold")
    sink = spooled(tmp_path / "spool", carrier)
    for number in range(3):
        sink.write(window(5, 5 * number))
    until(lambda: len(carrier.held) == 3)
    carrier.held.pop(1).set_result(None)
    assert sink.close() == Delivery(delivered=5, spooled=10)
    again = Holding()
    assert spooled(tmp_path / "spool", again).close() == Delivery(delivered=10, recovered=10)
    assert again.ids == ids_of(window(5), window(5, 10))


def test_writing_waits_for_no_carrier(tmp_path: Path) -> None:
    carrier = Holding("hold")
    sink = spooled(tmp_path / "spool", carrier)
    began = time.monotonic()
    for number in range(20):
        sink.write(window(1000, 1000 * number))
    assert time.monotonic() - began < 10.0
    assert sum(len(parcel.body) for parcel in carrier.parcels) < AHEAD_BYTES + MIB
    standing = sink.standing()
    assert (standing.delivered, standing.spooled) == (0, 20_000)
    carrier.release()
    assert sink.close() == Delivery(delivered=20_000)
    assert carrier.ids == ids_of(window(20_000))


def test_a_carrier_that_fails_for_good_fails_the_sink_and_the_spool_keeps_the_events(tmp_path: Path) -> None:
    sink = spooled(tmp_path / "spool", Holding("fail"))
    sink.write(window(5))
    until(lambda: sink.standing().complaint is not None)
    with pytest.raises(SinkError, match="stub: the broker refuses it"):
        sink.write(window(5, 5))
    assert sink.close() == Delivery(delivered=0, spooled=5, complaint="stub: the broker refuses it")


def test_a_carrier_that_fails_at_the_end_is_told_by_closing(tmp_path: Path) -> None:
    carrier = Holding("hold")
    sinks = {"a": spooled(tmp_path / "spool", carrier), "b": unspooled(Holding("hold"))}
    report = pump([window(5)], sinks)
    kept, lost = report.sinks
    assert (kept.spooled, kept.dropped, kept.error) == (5, 0, None)
    assert (lost.spooled, lost.dropped) == (0, 5)
    assert lost.error == "stub: no acknowledgement came; a spool would keep what is lost"


def test_a_defect_of_a_carrier_is_passed_on(tmp_path: Path) -> None:
    class Broken(Holding):
        def carry(self, parcel: parcels.Parcel) -> "Future[None]":
            raise ZeroDivisionError

    sink = spooled(tmp_path / "spool", Broken())
    sink.write(window(5))
    until(lambda: sink.standing().complaint is not None)
    with pytest.raises(ZeroDivisionError):
        sink.write(window(5))
    with pytest.raises(ZeroDivisionError):
        sink.close()


@pytest.mark.parametrize("is_spooled", [True, False])
def test_a_full_backlog_refuses(tmp_path: Path, is_spooled: bool) -> None:
    sink = small(tmp_path, Holding("hold"), "refuse", is_spooled=is_spooled)
    with pytest.raises(SinkError, match=r"stub: its (spool .*|queue) is full, with \d+ events that wait"):
        overfill(sink)
    told = sink.close()
    assert (told.spooled > 1000) is is_spooled
    assert told.spooled + told.dropped > 1000


@pytest.mark.parametrize("is_spooled", [True, False])
def test_a_full_backlog_drops_the_newest_and_counts(tmp_path: Path, is_spooled: bool) -> None:
    carrier = Holding("hold")
    sink = small(tmp_path, carrier, "drop-newest", is_spooled=is_spooled)
    events = overfill(sink)
    carrier.release()
    told = sink.close()
    assert told.dropped > 1000
    assert told.delivered + told.dropped == events
    assert carrier.ids == ids_of(window(events))[: told.delivered]


@pytest.mark.parametrize("is_spooled", [True, False])
def test_a_full_backlog_drops_the_oldest_that_is_not_on_its_way_and_counts(tmp_path: Path, is_spooled: bool) -> None:
    carrier = Holding("hold")
    sink = small(tmp_path, carrier, "drop-oldest", is_spooled=is_spooled)
    events = overfill(sink)
    carrier.release()
    told = sink.close()
    assert told.dropped > 1000
    assert told.delivered + told.dropped == events
    everything = ids_of(window(events))
    assert carrier.ids[-1] == everything[-1]
    place = {each: number for number, each in enumerate(everything)}
    assert carrier.ids == sorted(carrier.ids, key=place.__getitem__)


@pytest.mark.parametrize("is_spooled", [True, False])
def test_a_full_backlog_waits_for_room(tmp_path: Path, is_spooled: bool) -> None:
    carrier = Appending(tmp_path / "arrived", 0.002)
    sink = small(tmp_path, carrier, "wait", is_spooled=is_spooled, wait_s=20.0)
    events = overfill(sink)
    assert sink.close() == Delivery(delivered=events)
    assert (tmp_path / "arrived").read_bytes() == ENCODER.encode(window(events))


def test_waiting_for_room_has_an_end(tmp_path: Path) -> None:
    sink = small(tmp_path, Holding("hold"), "wait", is_spooled=True)
    with pytest.raises(SinkError, match="is full"):
        overfill(sink)
    sink.close()


def test_the_file_stays_within_its_bound(tmp_path: Path) -> None:
    path = tmp_path / "spool"
    journal = Journal(str(path), 2 * MIB)
    parcel = next(Packer(ENCODER, SENSORS).parcels(window(300)))
    tiny = next(Packer(ENCODER, SENSORS).parcels(window(1)))
    for each in (parcel, tiny):
        with pytest.raises(FullError):
            put_for_ever(journal, each)
        assert path.stat().st_size < 2.2 * MIB
        assert (tmp_path / "spool-wal").stat().st_size < 6 * MIB
    numbers = iter(lambda: journal.drop_oldest(0), 0)
    assert sum(numbers) > 1000
    journal.put(parcel)
    journal.close()
    assert path.stat().st_size < 2.2 * MIB


def test_a_disk_without_room_is_a_full_spool(tmp_path: Path) -> None:
    """SQLite's own bound on pages stands for the disk's: both are told as SQLITE_FULL."""
    journal = Journal(str(tmp_path / "spool"), 1 << 40)
    pages = journal._database.execute("PRAGMA page_count").fetchone()[0]
    journal._database.execute(f"PRAGMA max_page_count = {pages + 400}")
    carrier = Holding("hold")
    sink = Dispatch("stub", carrier, journal, Packer(ENCODER, SENSORS), QUICK)
    with pytest.raises(SinkError, match="is full"):
        overfill(sink)
    carrier.release()
    told = sink.close()
    assert told.delivered > 1000
    assert carrier.ids == ids_of(window(told.delivered))


@pytest.mark.skipif(not Path("/dev/full").exists(), reason="this system has no /dev/full")
@pytest.mark.parametrize("place", ["/dev/full", "/dev/null"])
def test_a_device_is_no_spool(place: str) -> None:
    with pytest.raises(SinkError, match=f"the spool {place} "):
        Journal(place, MIB)


def test_a_spool_in_use_is_refused(tmp_path: Path) -> None:
    first = spooled(tmp_path / "spool", Holding())
    with pytest.raises(SinkError, match=r"the spool .* is in use by another process; stop that, or give"):
        Journal(str(tmp_path / "spool"), MIB)
    first.close()
    Journal(str(tmp_path / "spool"), MIB).close()


def test_a_file_that_is_no_database_is_refused_and_left_alone(tmp_path: Path) -> None:
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


def test_a_missing_folder_is_told(tmp_path: Path) -> None:
    with pytest.raises(SinkError, match="there is no folder"):
        Journal(str(tmp_path / "missing" / "spool"), MIB)
    with pytest.raises(SinkError, match="cannot be opened"):
        Journal(str(tmp_path), MIB)


@pytest.mark.parametrize("seed", range(12))
def test_damage_anywhere_in_the_file_is_told_or_harmless_and_never_sent(tmp_path: Path, seed: int) -> None:
    path = tmp_path / "spool"
    journal = Journal(str(path), 64 * MIB)
    for number in range(4):
        journal.put(next(Packer(ENCODER, SENSORS).parcels(window(200, 200 * number))))
    journal.close()
    damaged = bytearray(path.read_bytes())
    dice = random.Random(seed)
    for _ in range(8):
        damaged[dice.randrange(len(damaged))] ^= 1 << dice.randrange(8)
    path.write_bytes(damaged)
    whole = set(ids_of(window(800)))
    carrier = Holding()
    try:
        sink = spooled(path, carrier)
    except SinkError as error:
        assert str(error).startswith(("the spool ", str(path)))  # noqa: PT017
    else:
        told = sink.close()
        assert set(carrier.ids) <= whole
        assert told.complaint is not None or told.delivered == 800


def test_a_sink_in_a_hurry_is_closed_in_time(tmp_path: Path) -> None:
    patient = Policy(when_full="wait", wait_s=60.0, stall_s=60.0)
    sink = spooled(tmp_path / "spool", Holding("hold"), patient, 10 * MIB)
    refused: list[SinkError] = []

    def fill_it() -> None:
        try:
            overfill(sink)
        except SinkError as error:
            refused.append(error)

    filling = threading.Thread(target=fill_it)
    filling.start()
    until(lambda: sink.standing().spooled > 10_000)
    began = time.monotonic()
    sink.hurry(began + 2.5)
    filling.join()
    told = sink.close()
    assert time.monotonic() - began < 2.5
    assert told.spooled > 10_000
    assert "is full" in str(refused[0])


def test_the_wall_clock_has_no_say(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    jumps = iter(range(10**6, -(10**9), -(10**5)))
    monkeypatch.setattr(time, "time", lambda: float(next(jumps)))
    carrier = Holding("hold")
    sink = spooled(tmp_path / "spool", carrier)
    sink.write(window(100))
    carrier.release()
    assert sink.close() == Delivery(delivered=100)


def test_a_plain_sink_can_have_a_spool_too(tmp_path: Path) -> None:
    known = stub_estimates(3, launch=[[0.1, 0.2, 0.3], [0.4, 0.5, 0.6], [0.7, 0.8, 0.9]])
    windows = [stub_window(4, estimates=known, estimate=[2, -1, 0, 2], track=1), window(2, 4)]
    first = Dispatch("stub", Holding("hold"), Journal(str(tmp_path / "spool"), MIB), WindowPacker(), QUICK)
    for each in windows:
        first.write(each)
    assert first.close() == Delivery(delivered=0, spooled=6)
    kept = Memory(lambda: ENCODER)
    second = Dispatch("stub", WindowCarrier(kept), Journal(str(tmp_path / "spool"), MIB), WindowPacker(), QUICK)
    assert second.close() == Delivery(delivered=6, recovered=6)
    assert kept.lines() == b"".join(map(ENCODER.encode, windows))
    assert isinstance(kept.windows[0].tracks, Tracks)
    assert not any(len(each.truth) for each in kept.windows)


def test_a_spool_of_another_output_is_told(tmp_path: Path) -> None:
    first = spooled(tmp_path / "spool", Holding("hold"))
    first.write(window(5))
    first.close()
    kept = Memory(lambda: ENCODER)
    second = Dispatch("memory", WindowCarrier(kept), Journal(str(tmp_path / "spool"), MIB), WindowPacker(), QUICK)
    told = second.close()
    assert told.spooled == 5
    assert told.complaint is not None
    assert "give each output a spool of its own" in told.complaint


def test_events_an_encoder_has_no_message_for_are_withheld_and_counted(tmp_path: Path) -> None:
    class Choosy:
        content_type, schema_version = ENCODER.content_type, ENCODER.schema_version
        encode = staticmethod(ENCODER.encode)

        def encodable(self, block: Any) -> Any:
            return block.detections.sensor != 2

    carrier = Holding()
    sink = Dispatch("stub", carrier, Journal(str(tmp_path / "spool"), MIB), Packer(Choosy(), SENSORS), QUICK)
    sink.write(window(10))
    assert sink.close() == Delivery(delivered=8, withheld=2)
    assert {event["sensor_id"] for event in carrier.events} == {"S-0", "S-1", "S-3", "S-4"}


def test_a_killed_process_loses_nothing_and_keeps_the_order(tmp_path: Path) -> None:
    """SIGKILL at 20 moments of one spool's life; each process goes on where the one before was killed."""
    first = killed_at_random("spool_stand", "spool_for_ever", tmp_path, 20, 0.05)
    rest = spooled(tmp_path / "spool", Appending(tmp_path / "arrived", 0.0), Policy(stall_s=5.0))
    assert rest.close().spooled == 0
    lines = whole_lines(tmp_path / "arrived")
    arrived = list(dict.fromkeys(json.loads(line)["detection_id"] for line in lines))
    everything = ids_of(window(first))
    # The window that was being written when the process was killed may have been taken without being noted.
    assert [each for each in everything if each not in set(arrived)] == []
    assert arrived == sorted(arrived, key={each: place for place, each in enumerate(ids_of(window(first + 7)))}.get)


def whole_lines(path: Path) -> list[bytes]:
    """Return the lines of the file; a carrier that was killed leaves torn ones, which are sent again."""
    return [line for line in path.read_bytes().split(b"\n") if line.startswith(b"{") and line.endswith(b"}")]


def small(tmp_path: Path, carrier: Any, when_full: str, *, is_spooled: bool, wait_s: float = 0.2) -> Dispatch:
    policy = Policy(when_full=when_full, wait_s=wait_s, stall_s=0.3)
    if is_spooled:
        return spooled(tmp_path / "spool", carrier, policy, 10 * MIB)
    return unspooled(carrier, policy, 10 * MIB)


def overfill(sink: Dispatch) -> int:
    """Write twice what the small backlogs hold, and return how many events that is."""
    for each in many_windows():
        sink.write(each)
    return 40_000


@cache
def many_windows() -> list[Window]:
    return [window(1000, 1000 * number) for number in range(40)]


def put_for_ever(journal: Journal, parcel: parcels.Parcel) -> None:
    while True:
        journal.put(parcel)


def test_a_carrier_that_takes_its_time_is_struck_off_as_it_goes_and_left_in_time(tmp_path: Path) -> None:
    journal = Journal(str(tmp_path / "spool"), 8 * MIB)
    sink = Dispatch(
        "stub", Appending(tmp_path / "lines", 0.02), journal, Packer(ENCODER, SENSORS), Policy(stall_s=60.0)
    )
    for first in range(300):
        sink.write(window(1, first))
    give_up_at = time.monotonic() + 30.0
    while not sink.standing().delivered:
        assert time.monotonic() < give_up_at
        time.sleep(0.01)
    assert sink.standing().spooled > 0
    began = time.monotonic()
    sink.hurry(began + 2.2)
    told = sink.close()
    assert time.monotonic() - began < 5.0
    assert told.delivered + told.spooled == 300
    assert told.delivered == (tmp_path / "lines").read_bytes().count(b"\n")
    assert told.spooled > 0
