"""The fault campaign of the Kafka sink: whatever befalls broker, disk or process, events in are
events out.

Every scenario ends with the same examination: all events are in the topic, each sensor's in order
by their first arrival, what is there twice is there unchanged. Scenarios that have to spoil the
broker need the mock one; the others run against any broker that KAFKA_BOOTSTRAP names.
"""

import json
import random
import signal
import threading
import time
from contextlib import closing

import kafka_broker
import pytest
from aiokafka import errors
from attrs import evolve
from forked_processes import killed_at_random
from kafka_broker import (
    INIT_PRODUCER_ID,
    METADATA,
    PERMANENT_CODES,
    PRODUCE,
    MockBroker,
    brief,
    closed,
    dead_address,
    examine,
    kafka_sink,
    messages,
)
from opir_kafka.connection import connector
from opir_kafka.transport import KafkaTransport
from spool_transports import ENCODER, SENSORS, fill, window
from waiting import until

from opir_core.errors import SinkError
from opir_core.interfaces.outputs import Delivery
from opir_core.output.pump import SinkGroup
from opir_core.output.spool.batches import EncodedBatcher
from opir_core.output.spool.journal import Journal
from opir_core.output.spool.policy import Policy
from opir_core.output.spool.transport_sink import TransportSink

#: Codes that the protocol's table gives for taking messages and that may pass. 46
#: (DUPLICATE_SEQUENCE_NUMBER) is not among them: it says that the message is there.
PASSING_CODES = (
    -1,
    2,
    3,
    5,
    6,
    7,
    8,
    9,
    13,
    14,
    15,
    16,
    19,
    20,
    41,
    45,
    47,
    49,
    51,
    56,
    59,
    72,
    74,
    75,
    89,
)


@pytest.fixture(scope="module")
def one_broker():
    with kafka_broker.broker() as made:
        yield made


@pytest.fixture
def broker(one_broker):
    yield one_broker
    one_broker.heal()


@pytest.fixture
def mock(broker):
    if not broker.can_be_spoilt:
        pytest.skip("only the mock broker can be spoilt")
    return broker


@pytest.fixture
def spool(tmp_path):
    return tmp_path / "spool"


def test_all_is_well(broker, spool):
    topic = broker.topic()
    sink = kafka_sink(broker.address, topic, spool)
    fill(sink, 3, 700, 0, 0.0)
    assert closed(sink) == Delivery(delivered=2100)
    examine(broker, topic, 2100)
    message = messages(broker.address, topic)[0]
    assert dict(message.headers()) == {
        "content-type": b"application/json",
        "schema-version": b"2.0",
    }


def test_the_broker_is_absent_from_first_to_last_and_there_at_the_next_run(broker, spool):
    topic = broker.topic()
    absent = kafka_sink(dead_address(), topic, spool, brief())
    fill(absent, 3, 50, 0, 0.0)
    assert "no broker answers" in (absent.delivery_so_far().complaint or "")
    assert closed(absent) == Delivery(delivered=0, spooled=150)
    present = kafka_sink(broker.address, topic, spool)
    fill(present, 1, 50, 150, 0.0)
    assert closed(present) == Delivery(delivered=200, recovered=150)
    examine(broker, topic, 200)


@pytest.mark.parametrize("is_spooled", [True, False])
def test_the_broker_comes_late(mock, spool, is_spooled):
    topic = mock.topic()
    mock.tell("down")
    sink = kafka_sink(mock.address, topic, spool if is_spooled else None)
    fill(sink, 5, 50, 0, 0.02)
    mock.tell("up")
    fill(sink, 5, 50, 250, 0.02)
    assert closed(sink) == Delivery(delivered=500)
    examine(mock, topic, 500)


@pytest.mark.slow
@pytest.mark.parametrize("is_spooled", [True, False])
def test_the_broker_goes_and_comes_back(mock, spool, is_spooled):
    topic = mock.topic()
    sink = kafka_sink(mock.address, topic, spool if is_spooled else None)
    fill(sink, 10, 30, 0, 0.01)
    mock.tell("down")
    fill(sink, 10, 30, 300, 0.01)
    mock.tell("up")
    fill(sink, 10, 30, 600, 0.01)
    assert closed(sink) == Delivery(delivered=900)
    examine(mock, topic, 900)


@pytest.mark.slow
def test_the_broker_goes_and_the_run_ends_without_it(mock, spool):
    topic = mock.topic()
    sink = kafka_sink(mock.address, topic, spool, brief())
    fill(sink, 10, 30, 0, 0.02)
    mock.tell("down")
    fill(sink, 10, 30, 300, 0.01)
    reported = closed(sink)
    assert reported.delivered + reported.spooled == 600
    assert reported.spooled >= 300
    mock.tell("up")
    assert closed(kafka_sink(mock.address, topic, spool)) == Delivery(
        delivered=reported.spooled, recovered=reported.spooled
    )
    examine(mock, topic, 600)


@pytest.mark.slow
def test_the_broker_flaps(mock, spool):
    topic = mock.topic()
    rng = random.Random(5)
    sink = kafka_sink(mock.address, topic, spool)
    over = threading.Event()

    def flap():
        while not over.is_set():
            mock.tell("down")
            time.sleep(0.15 * rng.random())
            mock.tell("up")
            time.sleep(0.3 * rng.random())

    flapping = threading.Thread(target=flap)
    flapping.start()
    fill(sink, 100, 10, 0, 0.02)
    over.set()
    flapping.join()
    assert closed(sink) == Delivery(delivered=1000)
    examine(mock, topic, 1000)


@pytest.mark.slow
def test_the_broker_is_slow(mock, spool):
    topic = mock.topic()
    mock.tell("slow", 150)
    sink = kafka_sink(mock.address, topic, spool)
    fill(sink, 10, 20, 0, 0.01)
    assert closed(sink) == Delivery(delivered=200)
    examine(mock, topic, 200)


@pytest.mark.slow
def test_the_broker_is_slower_than_every_deadline(mock, spool):
    topic = mock.topic()
    sink = kafka_sink(mock.address, topic, spool)
    fill(sink, 5, 20, 0, 0.05)
    mock.tell("slow", 2500)
    fill(sink, 5, 20, 100, 0.01)
    time.sleep(2.5)
    assert "in time" in (sink.delivery_so_far().complaint or "")
    mock.tell("slow", 0)
    assert closed(sink) == Delivery(delivered=200)
    examine(mock, topic, 200)


@pytest.mark.slow
@pytest.mark.skipif(not hasattr(signal, "SIGSTOP"), reason="this system cannot stop a process")
def test_the_broker_stops_answering_with_every_connection_open(mock, spool):
    topic = mock.topic()
    sink = kafka_sink(mock.address, topic, spool, brief(stall_s=2.5))
    fill(sink, 5, 20, 0, 0.02)
    mock.freeze()
    try:
        fill(sink, 5, 20, 100, 0.01)
        reported = closed(sink)
    finally:
        mock.thaw()
    assert reported.delivered + reported.spooled == 200
    assert reported.spooled >= 100
    assert closed(kafka_sink(mock.address, topic, spool)).delivered == reported.spooled
    examine(mock, topic, 200)


@pytest.mark.slow
def test_the_broker_answers_with_every_code_that_may_pass(mock, spool):
    topic = mock.topic(1)
    sink = kafka_sink(mock.address, topic, spool)
    fill(sink, 1, 20, 0, 0.0)
    mock.tell("error", PRODUCE, *PASSING_CODES)
    fill(sink, 30, 20, 20, 0.01)
    assert closed(sink) == Delivery(delivered=620)
    examine(mock, topic, 620)


@pytest.mark.slow
@pytest.mark.parametrize("code", PERMANENT_CODES)
def test_the_broker_answers_with_a_code_that_cannot_pass(mock, spool, code):
    topic = mock.topic(1)
    mock.tell("error", PRODUCE, *[code] * 20)
    sink = kafka_sink(mock.address, topic, spool, brief(stall_s=5.0))
    fill(sink, 1, 40, 0, 0.0)
    until(lambda: sink.parked is not None)
    fill(sink, 1, 40, 40, 0.0)
    reported = closed(sink)
    assert (reported.spooled, reported.dropped) == (80, 0)
    assert f"(code {code})" in (reported.complaint or "")
    mock.tell("clear", PRODUCE)
    assert closed(kafka_sink(mock.address, topic, spool)) == Delivery(delivered=80, recovered=80)
    examine(mock, topic, 80)


@pytest.mark.parametrize("is_reported", [False, True])
def test_a_permission_that_is_lost_and_given_back_loses_nothing(mock, spool, is_reported):
    topic = mock.topic()
    policy = evolve(brief(stall_s=8.0), retry_s=60.0 if is_reported else 0.3)
    sink = kafka_sink(mock.address, topic, spool, policy)
    fill(sink, 5, 20, 0, 0.0)
    until(lambda: sink.delivery_so_far().delivered == 100)
    mock.tell("error", PRODUCE, *[29] * 20)
    fill(sink, 5, 20, 100, 0.0)
    until(lambda: sink.parked is not None)
    assert "TopicAuthorizationFailedError (code 29); let this login write to the topic" in (
        sink.parked or ""
    )
    fill(sink, 5, 20, 200, 0.01)
    mock.tell("clear", PRODUCE)
    assert not is_reported or sink.retry()
    until(lambda: sink.delivery_so_far().delivered == 300)
    assert sink.parked is None
    assert closed(sink) == Delivery(delivered=300)
    examine(mock, topic, 300)


def test_a_login_that_is_refused_and_let_in_loses_nothing(mock, spool):
    topic = mock.topic()
    settings = kafka_broker.config(mock.address, topic)
    connect = connector(settings)
    refusals = [errors.SaslAuthenticationFailed(), errors.SaslAuthenticationFailed()]

    async def refused_at_first():
        if refusals:
            raise refusals.pop()
        return await connect()

    transport = KafkaTransport(settings, refused_at_first)
    policy = evolve(brief(stall_s=8.0), retry_s=60.0)
    sink = TransportSink(
        "kafka", transport, Journal(str(spool), 64 << 20), EncodedBatcher(ENCODER, SENSORS), policy
    )
    fill(sink, 5, 20, 0, 0.0)
    until(lambda: sink.parked is not None)
    assert "(code 58); see security.username" in (sink.parked or "")
    sink.retry()
    until(lambda: not refusals)
    until(lambda: (sink.retry(), sink.delivery_so_far().delivered)[1] == 100)
    assert closed(sink) == Delivery(delivered=100)
    examine(mock, topic, 100)


@pytest.mark.slow
@pytest.mark.parametrize("api", [METADATA, INIT_PRODUCER_ID])
def test_the_broker_cannot_even_begin(mock, spool, api):
    topic = mock.topic()
    mock.tell("error", api, *(3, 5, 7, 8, 15, 41, -1)[: 3 if api == METADATA else 7])
    sink = kafka_sink(mock.address, topic, spool)
    fill(sink, 5, 20, 0, 0.01)
    assert closed(sink) == Delivery(delivered=100)
    examine(mock, topic, 100)


@pytest.mark.slow
def test_the_topic_is_not_there_yet(mock, spool):
    topic = mock.topic()
    mock.tell("topic-error", topic, 3)
    sink = kafka_sink(mock.address, topic, spool)
    fill(sink, 5, 20, 0, 0.3)
    until(lambda: f"there is no topic {topic}; make it" in (sink.trouble or ""))
    mock.tell("topic-error", topic, 0)
    assert closed(sink) == Delivery(delivered=100)
    examine(mock, topic, 100)


@pytest.mark.slow
def test_a_leader_that_is_away_is_named(spool):
    with closing(MockBroker(2)) as brokers:
        topic = brokers.topic(1)
        brokers.tell("leader", topic, 0, 1)
        sink = kafka_sink(brokers.address, topic, spool, Policy(stall_s=30.0))
        fill(sink, 2, 20, 0, 0.0)
        until(lambda: sink.delivery_so_far().delivered == 40)
        brokers.tell("down", 1)
        fill(sink, 2, 20, 40, 0.0)
        until(lambda: "the leader of partition 0, broker 1, is away" in (sink.trouble or ""))
        brokers.heal()
        until(lambda: sink.delivery_so_far().delivered == 80)
        assert sink.trouble is None
        assert closed(sink) == Delivery(delivered=80)


@pytest.mark.slow
def test_a_partition_without_a_leader_is_named(mock, spool):
    topic = mock.topic(2)
    sink = kafka_sink(mock.address, topic, spool)
    fill(sink, 2, 20, 0, 0.0)
    until(lambda: sink.delivery_so_far().delivered == 40)
    assert sink.trouble is None
    mock.tell("leader", topic, 1, -1)
    fill(sink, 5, 20, 40, 0.0)
    until(lambda: f"topic {topic}: partition 1 has no leader" in (sink.trouble or ""))
    seen = set()
    for number in range(10):  # the other partition goes on, and new connections are made
        fill(sink, 1, 20, 140 + 20 * number, 0.2)
        seen.add(sink.trouble)
    assert len(seen) == 1
    mock.tell("leader", topic, 1, 1)
    until(lambda: sink.delivery_so_far().delivered == 340)
    assert sink.trouble is None
    assert closed(sink) == Delivery(delivered=340)
    examine(mock, topic, 340)


def test_the_disk_is_full_and_the_broker_away(broker, spool):
    """SQLite's own bound on pages stands for the disk's: both are reported as SQLITE_FULL."""
    topic = broker.topic()
    sink = kafka_sink(dead_address(), topic, spool, brief())
    database = sink._store.backlog
    pages = database._database.execute("PRAGMA page_count").fetchone()[0]
    database._database.execute(f"PRAGMA max_page_count = {pages + 300}")
    with pytest.raises(SinkError, match=r"is full, with \d+ events that wait: no broker answers"):
        fill(sink, 1000, 100, 0, 0.0)
    stored = closed(sink).spooled
    assert stored >= 1000
    assert closed(kafka_sink(broker.address, topic, spool)) == Delivery(
        delivered=stored, recovered=stored
    )
    examine(broker, topic, stored)


def test_the_clock_jumps(broker, spool, monkeypatch):
    time_s = time.time()
    jumps = random.Random(3)
    monkeypatch.setattr(time, "time", lambda: time_s + jumps.uniform(-1e6, 1e6))
    topic = broker.topic()
    sink = kafka_sink(broker.address, topic, spool)
    fill(sink, 10, 20, 0, 0.01)
    reported = closed(sink)
    monkeypatch.undo()
    assert reported == Delivery(delivered=200)
    examine(broker, topic, 200)


def test_of_two_sinks_one_is_dead(broker, tmp_path):
    topic = broker.topic()
    second_topic = broker.topic()
    sinks = {
        "dead": kafka_sink(dead_address(), second_topic, tmp_path / "dead", brief()),
        "alive": kafka_sink(broker.address, topic, tmp_path / "alive"),
    }
    with SinkGroup(sinks) as outlets:
        fill(outlets, 20, 20, 0, 0.0)
        until(lambda: sinks["alive"].delivery_so_far().delivered == 400)
    dead, alive = outlets.report().sinks
    assert (dead.spooled, dead.error) == (400, None)
    assert (alive.delivered, alive.error) == (400, None)
    assert closed(kafka_sink(broker.address, second_topic, tmp_path / "dead")).delivered == 400
    for name in (topic, second_topic):
        examine(broker, name, 400)


def test_without_a_spool_what_is_lost_is_counted(spool):
    sink = kafka_sink(dead_address(), "nowhere", None, brief())
    fill(sink, 5, 20, 0, 0.0)
    reported = closed(sink)
    assert (reported.delivered, reported.dropped) == (0, 100)
    assert "no broker answers" in (reported.complaint or "")


@pytest.mark.slow
def test_the_process_is_killed_at_20_moments(broker, tmp_path):
    topic = broker.topic()
    start = killed_at_random(
        "kafka_broker", "kafka_for_ever", tmp_path, 20, 0.15, broker.address, topic
    )
    remainder = kafka_sink(broker.address, topic, tmp_path / "spool")
    remainder.write(window(7, start))  # the window whose writing was not noted may have been taken
    reported_last = closed(remainder)
    assert (reported_last.spooled, reported_last.dropped) == (0, 0)
    examine(broker, topic, start + 7)


def test_there_are_sensors_for_every_partition():
    assert len(SENSORS) > kafka_broker.PARTITIONS


#: The timeouts of a sink by default, about.
PATIENT = {"connect_timeout_s": 20.0, "request_timeout_s": 20.0, "acknowledgement_timeout_s": 25.0}


@pytest.mark.slow
@pytest.mark.parametrize("slow_ms", [200, 1_000, 1_500, 5_000])
def test_a_broker_that_answers_slowly_gets_everything_once(mock, spool, slow_ms):
    topic = mock.topic(1)
    sink = kafka_sink(mock.address, topic, spool, Policy(stall_s=30.0, trouble_s=3.0), **PATIENT)
    until(lambda: sink.delivery_so_far().complaint is None)
    mock.tell("slow", slow_ms)
    sink.write(window(750))
    try:
        assert sink.close() == Delivery(delivered=750)
    finally:
        mock.tell("slow", 0)
    assert len(messages(mock.address, topic)) == 750


@pytest.mark.slow
def test_what_is_acknowledged_of_a_batch_is_not_sent_again(mock, spool):
    topic = mock.topic(1)
    events = 750
    sink = kafka_sink(mock.address, topic, spool, brief(stall_s=4.0), **PATIENT)
    until(lambda: sink.delivery_so_far().complaint is None)
    mock.tell("slow", 700)
    sink.write(window(events))
    sink.close_by(time.monotonic() + 2.0 + 2.5)
    reported = sink.close()
    mock.tell("slow", 0)
    assert 0 < reported.delivered < events
    assert reported.delivered + reported.spooled == events
    time.sleep(1.0)
    repeat = closed(kafka_sink(mock.address, topic, spool))
    assert repeat == Delivery(delivered=reported.spooled, recovered=reported.spooled)
    result = messages(mock.address, topic)
    assert len({json.loads(message.value())["detection_id"] for message in result}) == events
    # What was under way at the end may arrive twice: one batch of the broker's, not all.
    assert len(result) <= events + events // 3
