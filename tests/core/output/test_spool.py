"""The spool: nothing that was taken is lost, order is kept, what cannot be kept is counted."""

import json
import threading
import time
from concurrent.futures import Future
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from attrs import evolve
from forked_processes import killed_at_random
from opir_testing import stub_estimates, stub_regions, stub_sensor, stub_window
from opir_testing.doubles import stub_hypotheses
from spool_transports import (
    ENCODER,
    MIB,
    ORIGIN,
    PATIENT,
    QUICK,
    SENSORS,
    Appending,
    Holding,
    ids_of,
    overfill,
    spooled,
    unspooled,
    window,
)
from waiting import until, within

from opir_core.builtin.sinks import MemorySink
from opir_core.errors import SinkError
from opir_core.output import ForgeEncoder
from opir_core.output.pump import pump
from opir_core.output.spool import (
    AHEAD_BYTES,
    BATCH_EVENTS,
    CONTENT_TYPE,
    VERSION,
    EncodedBatcher,
    Journal,
    Origin,
    Policy,
    TransportSink,
    WindowBatcher,
    WindowTransport,
)
from opir_core.plugin import Batch, Delivery, Encoder, EncoderContext, Tracks


def test_what_a_carrier_acknowledges_is_delivered(tmp_path: Path) -> None:
    carrier = Holding()
    sink = spooled(tmp_path / "spool", carrier)
    windows = [window(3), window(0), window(2500, 3)]
    for queued_window in windows:
        sink.write(queued_window)
    assert sink.close() == Delivery(delivered=2503)
    assert carrier.ids == ids_of(*windows)
    assert carrier.closed == 1


def test_a_parcel_says_whose_each_event_is_and_what_it_is() -> None:
    large_window = window(3000)
    packed = list(EncodedBatcher(ENCODER, SENSORS).batches(large_window))
    assert [len(parcel) for parcel in packed] == [
        BATCH_EVENTS,
        BATCH_EVENTS,
        3000 - 2 * BATCH_EVENTS,
    ]
    assert b"".join(parcel.body for parcel in packed) == ENCODER.encode(large_window)
    for parcel in packed:
        keys = [parcel.keys[key] for key in parcel.key_of]
        assert keys == [json.loads(line)["sensor_id"] for line in parcel.messages()]
        assert (parcel.content_type, parcel.schema_version) == ("application/json", "2.0")


def test_unacknowledged_events_come_first_in_the_next_run(tmp_path: Path) -> None:
    first_sink = spooled(tmp_path / "spool", Holding("hold"))
    first_sink.write(window(1500))
    assert first_sink.close() == Delivery(delivered=0, spooled=1500)
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
    second_transport = Holding()
    assert spooled(tmp_path / "spool", second_transport).close() == Delivery(
        delivered=10, recovered=10
    )
    assert second_transport.ids == ids_of(window(5), window(5, 10))


@pytest.mark.slow
def test_writing_waits_for_no_carrier(tmp_path: Path) -> None:
    carrier = Holding("hold")
    sink = spooled(tmp_path / "spool", carrier)
    within(60.0, lambda: [sink.write(window(1000, 1000 * number)) for number in range(20)])
    assert sum(len(parcel.body) for parcel in carrier.parcels) < AHEAD_BYTES + MIB
    standing = sink.delivery_so_far()
    assert (standing.delivered, standing.spooled) == (0, 20_000)
    carrier.release()
    assert sink.close() == Delivery(delivered=20_000)
    assert carrier.ids == ids_of(window(20_000))


PARKS = evolve(QUICK, retry_s=0.05, longest_retry_s=0.2)


def test_a_final_refusal_parks_a_sink_with_a_spool(tmp_path: Path) -> None:
    carrier = Holding("fail")
    sink = spooled(tmp_path / "spool", carrier, evolve(QUICK, retry_s=60.0))
    sink.write(window(5))
    until(lambda: sink.parked is not None)
    for number in range(1, 20):
        sink.write(window(5, 5 * number))
    assert sink.parked == sink.delivery_so_far().complaint == "stub: the broker refuses it"
    assert (sink.delivery_so_far().spooled, sink.delivery_so_far().dropped) == (100, 0)
    time.sleep(0.2)
    tried = len(carrier.parcels)
    assert sink.retry()
    until(lambda: len(carrier.parcels) > tried)
    until(lambda: sink.parked is not None)
    carrier.mood = "take"
    assert sink.retry()
    until(lambda: sink.parked is None)
    assert not sink.retry()
    assert sink.close() == Delivery(delivered=100)
    assert list(dict.fromkeys(carrier.ids)) == ids_of(window(100))


@pytest.mark.slow
def test_a_parked_sink_tries_again_by_itself_and_later_each_time(tmp_path: Path) -> None:
    carrier = Holding("fail")
    sink = spooled(tmp_path / "spool", carrier, PARKS)
    sink.write(window(5))
    until(lambda: len(carrier.parcels) > 3)
    carrier.mood = "take"
    until(lambda: sink.delivery_so_far().delivered == 5)
    assert sink.parked is None
    assert sink.close() == Delivery(delivered=5)


def test_closing_tries_once_more_and_keeps_what_is_refused(tmp_path: Path) -> None:
    carrier = Holding("fail")
    sink = spooled(tmp_path / "spool", carrier, evolve(QUICK, retry_s=60.0))
    sink.write(window(5))
    until(lambda: sink.parked is not None)
    tried = len(carrier.parcels)
    assert sink.close() == Delivery(delivered=0, spooled=5, complaint="stub: the broker refuses it")
    assert len(carrier.parcels) == tried + 1
    second_sink = spooled(tmp_path / "spool", Holding())
    assert second_sink.close() == Delivery(delivered=5, recovered=5)


def test_a_final_refusal_ends_a_sink_without_a_spool() -> None:
    sink = unspooled(Holding("fail"))
    sink.write(window(5))
    until(lambda: sink.delivery_so_far().complaint is not None)
    with pytest.raises(SinkError, match="stub: the broker refuses it"):
        sink.write(window(5, 5))
    reported = sink.close()
    assert (reported.delivered, reported.spooled, reported.dropped) == (0, 0, 5)


def test_a_carrier_that_fails_at_the_end_is_reported_by_closing(tmp_path: Path) -> None:
    carrier = Holding("hold")
    sinks = {"a": spooled(tmp_path / "spool", carrier), "b": unspooled(Holding("hold"))}
    report = pump([window(5)], sinks)
    selected, lost = report.sinks
    assert (selected.spooled, selected.dropped, selected.error) == (5, 0, None)
    assert (lost.spooled, lost.dropped) == (0, 5)
    assert lost.error == "stub: no acknowledgement came; a spool would keep what is lost"


def test_a_defect_of_a_carrier_is_passed_on(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("opir_core.output.spool.sender.TROUBLED_S", 0.0)

    class Broken(Holding):
        def send(self, batch: Batch) -> "Future[None]":
            raise ZeroDivisionError

    sink = spooled(tmp_path / "spool", Broken())
    sink.write(window(5))
    until(lambda: sink.delivery_so_far().complaint is not None)
    until(lambda: sink.trouble is None)  # what raised is not what does not return
    with pytest.raises(ZeroDivisionError):
        sink.write(window(5))
    with pytest.raises(ZeroDivisionError):
        sink.close()


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
    until(lambda: sink.delivery_so_far().spooled > 10_000)
    began = time.monotonic()
    sink.close_by(began + 2.5)
    filling.join()
    reported = sink.close()
    assert (
        time.monotonic() - began < 30.0
    )  # of 60 s for which the sink may wait, on a machine that does other work
    assert reported.spooled > 10_000
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
    estimates = stub_estimates(3, launch=[[0.1, 0.2, 0.3], [0.4, 0.5, 0.6], [0.7, 0.8, 0.9]])
    windows = [stub_window(4, estimates=estimates, estimate=[2, -1, 0, 2], track=1), window(2, 4)]
    first_sink = TransportSink(
        "stub",
        Holding("hold"),
        Journal(str(tmp_path / "spool"), MIB),
        WindowBatcher(ENCODER, ORIGIN),
        QUICK,
    )
    for queued_window in windows:
        first_sink.write(queued_window)
    assert first_sink.close() == Delivery(delivered=0, spooled=6)
    memory_sink = MemorySink(lambda: ENCODER)
    second = TransportSink(
        "stub",
        WindowTransport(memory_sink, ORIGIN),
        Journal(str(tmp_path / "spool"), MIB),
        WindowBatcher(ENCODER, ORIGIN),
        PATIENT,
    )
    assert second.close() == Delivery(delivered=6, recovered=6)
    assert memory_sink.lines() == b"".join(map(ENCODER.encode, windows))
    assert isinstance(memory_sink.windows[0].tracks, Tracks)
    assert not any(len(queued_window.truth) for queued_window in memory_sink.windows)


def test_nothing_overtakes_a_batch_that_was_refused_at_once(tmp_path: Path) -> None:
    class Refusing(Holding):
        def send(self, batch: Batch) -> Any:
            self.mood = "fail" if self.sent == 2 else "take"
            self.sent += 1
            if self.mood == "take":
                self.taken += [json.loads(line)["detection_id"] for line in batch.messages()]
            return super().send(batch)

        sent = 0

    first_sink = spooled(tmp_path / "spool", Holding("hold"))
    windows = [window(3, 3 * number) for number in range(8)]
    for queued_window in windows:
        first_sink.write(queued_window)
    assert first_sink.close().spooled == 24
    carrier = Refusing()
    carrier.taken = list[str]()
    sink = spooled(tmp_path / "spool", carrier, Policy(stall_s=5.0, retry_s=0.01))
    until(lambda: sink.parked is None and len(carrier.taken) >= 24)
    assert sink.close() == Delivery(delivered=24, recovered=24)
    assert carrier.taken == ids_of(*windows)


def test_spooled_columns_keep_times_and_sensors_at_another_epoch(
    tmp_path: Path,
) -> None:
    estimates = stub_estimates(3, launch=[[0.1, 0.2, 0.3], [0.4, 0.5, 0.6], [0.7, 0.8, 0.9]])
    spooled_window = stub_window(
        4, estimates=estimates, estimate=[2, -1, 0, 2], track=1, sensor=[0, 1, 3, 4]
    )
    spool = str(tmp_path / "spool")
    first_sink = TransportSink(
        "stub", Holding("hold"), Journal(spool, MIB), WindowBatcher(ENCODER, ORIGIN), QUICK
    )
    first_sink.write(spooled_window)
    first_sink.close()
    sensors = (*SENSORS[::-1], stub_sensor("new"))
    origin = Origin(86_400_000_000, sensors)
    encoder = ForgeEncoder(EncoderContext(sensors=sensors, epoch_us=origin.epoch_us))
    memory_sink = MemorySink(lambda: encoder)
    second = TransportSink(
        "stub",
        WindowTransport(memory_sink, origin),
        Journal(spool, MIB),
        WindowBatcher(encoder, origin),
        PATIENT,
    )
    assert second.close() == Delivery(delivered=4, recovered=4)
    assert memory_sink.lines() == ENCODER.encode(spooled_window)


def test_events_of_a_removed_sensor_wait_in_the_spool(tmp_path: Path) -> None:
    spool = str(tmp_path / "spool")
    first_sink = TransportSink(
        "stub", Holding("hold"), Journal(spool, MIB), WindowBatcher(ENCODER, ORIGIN), QUICK
    )
    first_sink.write(window(5))
    first_sink.close()
    origin = Origin(0, SENSORS[:2])
    transport = WindowTransport(MemorySink(lambda: ENCODER), origin)
    second = TransportSink(
        "stub", transport, Journal(spool, MIB), WindowBatcher(ENCODER, origin), QUICK
    )
    reported = second.close()
    assert (reported.delivered, reported.spooled, reported.recovered) == (0, 5, 5)
    assert "holds events of S-2, which the scene does not have" in str(reported)


def test_a_spool_of_columns_keeps_impact_regions(tmp_path: Path) -> None:
    shared = stub_regions(9.0, 167.7, 200.0)
    hole = stub_regions(-5.0, -179.9)
    ring = hole[2].polygons[0][0]
    inner = hole[0].polygons[0][0]
    split_regions = (evolve(hole[1], polygons=((ring, inner), (inner + 0.2,))),)
    relighting = stub_regions(
        5.0, 5.0, condition="relights", probability=0.25, effective_samples=80.0
    )
    estimates = stub_estimates(
        4, impact_regions=[(*shared, *relighting), (), split_regions, shared]
    )
    estimates.impact_regions[3] = estimates.impact_regions[0]
    first_sink = TransportSink(
        "stub",
        Holding("hold"),
        Journal(str(tmp_path / "spool"), MIB),
        WindowBatcher(ENCODER, ORIGIN),
        QUICK,
    )
    first_sink.write(
        evolve(
            stub_window(4, estimates=estimates, estimate=[0, 1, 2, 3], track=1), tracks=estimates
        )
    )
    assert first_sink.close() == Delivery(delivered=0, spooled=4)
    memory_sink = MemorySink(lambda: ENCODER)
    second = TransportSink(
        "stub",
        WindowTransport(memory_sink, ORIGIN),
        Journal(str(tmp_path / "spool"), MIB),
        WindowBatcher(ENCODER, ORIGIN),
        evolve(QUICK, wait_s=30.0, stall_s=30.0),
    )
    assert second.close() == Delivery(delivered=4, recovered=4)
    for tracks in (memory_sink.windows[0].tracks, memory_sink.windows[0].estimates):
        assert tracks.impact_regions.tolist() == estimates.impact_regions.tolist()
        assert tracks.impact_regions[0] is tracks.impact_regions[3]


def test_tracks_of_other_hypotheses_wait_in_the_spool(tmp_path: Path) -> None:
    chances = stub_hypotheses(ICBM=0.75)
    estimates = stub_estimates(2, hypothesis_probability=chances, end=1)
    origin = Origin(0, SENSORS, hypotheses=tuple(f"H{number}" for number in range(len(chances))))
    packed = origin.packed(evolve(stub_window(2), tracks=estimates))
    batch = Batch(
        body=packed,
        keys=("",),
        key_of=np.zeros(2, dtype=np.uint16),
        content_type=CONTENT_TYPE,
        schema_version=VERSION,
    )
    tracks = origin.unpacked(batch).tracks
    assert np.array_equal(tracks.hypothesis_probability, [chances] * 2)
    assert tracks.end.tolist() == [1, 1]
    with pytest.raises(
        SinkError,
        match="its spool holds tracks with other hypotheses; run the scene that made them",
    ):
        Origin(0, SENSORS, hypotheses=("H0",)).unpacked(batch)
    with pytest.raises(
        SinkError,
        match=f"windows of version 0, and this opir reads {VERSION}; run the opir that made",
    ):
        origin.unpacked(evolve(batch, schema_version="0"))
    none = evolve(batch, body=origin.packed(evolve(stub_window(2), tracks=stub_estimates(2))))
    assert len(Origin(0, SENSORS).unpacked(none).tracks) == 2


def test_events_without_a_message_are_withheld_and_counted(tmp_path: Path) -> None:
    class Choosy(Encoder):
        content_type = ENCODER.content_type
        schema_version = ENCODER.schema_version
        encode = staticmethod(ENCODER.encode)

        def encodable(self, block: Any) -> Any:
            return block.detections.sensor != 2

    carrier = Holding()
    sink = TransportSink(
        "stub",
        carrier,
        Journal(str(tmp_path / "spool"), MIB),
        EncodedBatcher(Choosy(), SENSORS),
        PATIENT,
    )
    sink.write(window(10))
    assert sink.close() == Delivery(delivered=8, withheld=2)
    assert {event["sensor_id"] for event in carrier.events} == {"S-0", "S-1", "S-3", "S-4"}


@pytest.mark.slow
def test_a_killed_process_loses_nothing_and_keeps_the_order(tmp_path: Path) -> None:
    """SIGKILL at 20 moments of one spool's life; each process goes on where the one before was
    killed.
    """
    sent_count = killed_at_random("spool_transports", "spool_for_ever", tmp_path, 20, 0.05)
    remaining_sink = spooled(
        tmp_path / "spool", Appending(tmp_path / "arrived", 0.0), Policy(stall_s=5.0)
    )
    assert remaining_sink.close().spooled == 0
    lines = (tmp_path / "arrived").read_bytes().splitlines()
    whole_lines = [line for line in lines if is_whole(line)]
    assert len(lines) - len(whole_lines) <= 20
    arrived = list(dict.fromkeys(json.loads(line)["detection_id"] for line in whole_lines))
    everything = ids_of(window(sent_count))
    # The window that was being written when the process was killed may have been taken without
    # being noted.
    assert [event_id for event_id in everything if event_id not in set(arrived)] == []
    assert arrived == sorted(
        arrived,
        key={event_id: place for place, event_id in enumerate(ids_of(window(sent_count + 7)))}.get,
    )


def is_whole(line: bytes) -> bool:
    """Tell whether the line is an event; a kill leaves at most one that is torn."""
    try:
        json.loads(line)
    except json.JSONDecodeError:
        return False
    return True


def test_a_slow_transport_is_acknowledged_and_closed_in_time(
    tmp_path: Path,
) -> None:
    journal = Journal(str(tmp_path / "spool"), 8 * MIB)
    sink = TransportSink(
        "stub",
        Appending(tmp_path / "lines", 0.2),
        journal,
        EncodedBatcher(ENCODER, SENSORS),
        Policy(stall_s=60.0),
    )
    for scan in range(300):
        sink.write(window(1, scan))
    until(lambda: sink.delivery_so_far().delivered)
    assert sink.delivery_so_far().spooled > 0
    began = time.monotonic()
    sink.close_by(began + 2.2)
    reported = sink.close()
    assert time.monotonic() - began < 30.0  # of 60 s for all
    assert reported.delivered + reported.spooled == 300
    assert reported.delivered == (tmp_path / "lines").read_bytes().count(b"\n")
    assert reported.spooled > 0


class Overtaken(Holding):
    """A carrier whose `send` is under way when it is closed, and raises then."""

    def __init__(self) -> None:
        super().__init__()
        self.is_closed = threading.Event()

    def send(self, batch: Batch) -> "Future[None]":
        self.is_closed.wait(30.0)
        raise OSError("closed")

    def close(self, wait_s: float) -> None:
        self.is_closed.set()
        time.sleep(0.2)


def test_a_send_overtaken_by_a_close_keeps_its_events(tmp_path: Path) -> None:
    sink = spooled(tmp_path / "spool", Overtaken(), Policy(stall_s=60.0))
    sink.write(window(3))
    sink.close_by(time.monotonic() + 2.2)
    reported = sink.close()
    assert (reported.delivered, reported.spooled) == (0, 3)
