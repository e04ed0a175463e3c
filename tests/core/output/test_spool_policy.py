"""When a sink with a backlog is parked, tries again and gives up, and what it may send ahead;
without threads.
"""

from concurrent.futures import Future

import pytest

from opir_core.errors import SinkError
from opir_core.output.spool import (
    AHEAD_BYTES,
    Closing,
    MemoryBacklog,
    Parking,
    Policy,
    SentBatches,
    Store,
)
from opir_core.plugin import Batch

POLICY = Policy(stall_s=10.0, retry_s=5.0, longest_retry_s=12.0)


def test_a_sink_that_was_never_refused_is_not_parked() -> None:
    parking = Parking(POLICY)
    assert (parking.reason, parking.refused_from, parking.has_given_up) == (None, None, False)
    assert not parking.retry()


def test_a_refused_batch_is_sent_again_after_the_pause() -> None:
    parking = Parking(POLICY)
    parking.refuse(7, "no such topic", now_s=100.0)
    assert (parking.reason, parking.refused_from) == ("no such topic", 7)
    assert not parking.resume(104.9, is_closing=False)
    assert parking.resume(105.0, is_closing=False)
    assert (parking.reason, parking.refused_from) == (
        "no such topic",
        None,
    )  # parked until something is acknowledged
    parking.take()
    assert parking.reason is None


def test_the_first_refused_batch_is_sent_again_after_the_pause() -> None:
    parking = Parking(POLICY)
    for number, now_s in ((7, 100.0), (5, 103.0), (9, 104.0)):
        parking.refuse(number, f"reason {number}", now_s)
    assert (parking.reason, parking.refused_from) == ("reason 9", 5)
    assert parking.resume(105.0, is_closing=False)


def test_the_pause_doubles_until_an_acknowledgement() -> None:
    parking = Parking(POLICY)
    now_s = 0.0
    pauses = []
    for _ in range(4):
        parking.refuse(1, "refused", now_s)
        pauses.append(
            next(pause for pause in range(100) if parking.resume(now_s + pause, is_closing=False))
        )
        now_s += 100.0
    assert pauses == [5, 10, 12, 12]
    parking.take()
    parking.refuse(1, "refused", now_s)
    assert not parking.resume(now_s + 4.9, is_closing=False)
    assert parking.resume(now_s + 5.0, is_closing=False)


def test_a_request_ends_the_pause_once() -> None:
    parking = Parking(POLICY)
    parking.refuse(1, "refused", 0.0)
    assert parking.retry()
    assert parking.resume(0.0, is_closing=False)
    parking.refuse(1, "refused", 0.0)
    assert not parking.resume(9.9, is_closing=False)


def test_closing_tries_once_without_a_pause_and_then_gives_up() -> None:
    parking = Parking(POLICY)
    parking.refuse(1, "refused", 0.0)
    assert not parking.has_given_up
    assert parking.resume(0.0, is_closing=True)
    assert not parking.has_given_up
    parking.refuse(1, "refused again", 0.0)
    assert parking.has_given_up
    assert not parking.resume(1e9, is_closing=True)


@pytest.mark.parametrize(
    ("acknowledged_at", "end_at", "stalled_at"),
    [(0.0, 1e9, 30.0), (25.0, 1e9, 35.0), (25.0, 22.0, 22.0)],
)
def test_closing_waits_at_most_to_the_deadline(
    acknowledged_at: float, end_at: float, stalled_at: float
) -> None:
    closing = Closing(POLICY, acknowledged_at)
    closing.end_at = end_at
    assert not closing.is_stalled(1e12)  # it is open
    closing.since = 20.0
    assert not closing.is_stalled(stalled_at - 0.1)
    assert closing.is_stalled(stalled_at)


def batch(size: int = 3, events: int = 1) -> Batch:
    return Batch(
        body=b"x" * size, keys=("S-1",), key_of=[0] * events, content_type="", schema_version=""
    )  # type: ignore[arg-type]


def test_what_is_sent_ahead_is_bounded_in_bytes() -> None:
    sent = SentBatches()
    futures = [Future[None](), Future[None]()]
    sent.add(1, batch(AHEAD_BYTES - 1), futures[0])
    assert sent.has_room
    sent.add(2, batch(1), futures[1])
    assert not sent.has_room
    futures[1].set_result(None)
    (done,) = sent.done()
    assert (done.number, done.has_failed) == (2, False)
    sent.remove([done])
    assert sent.has_room
    assert len(sent) == 1


def test_what_is_done_is_in_the_order_of_sending() -> None:
    sent = SentBatches()
    futures = {number: Future[None]() for number in (1, 2, 3)}
    for number, future in futures.items():
        sent.add(number, batch(), future)
    futures[3].set_exception(SinkError("refused"))
    futures[1].set_result(None)
    assert [done.number for done in sent.done()] == [1, 3]
    futures[2].set_result(None)
    assert [done.number for done in sent.done()] == [1, 2, 3]
    sent.remove(sent.done())
    assert not sent.done()
    assert len(sent) == 0


@pytest.mark.parametrize("is_cancelled", [False, True])
def test_nothing_is_sent_behind_a_batch_that_failed(is_cancelled: bool) -> None:
    sent = SentBatches()
    future = Future[None]()
    sent.add(1, batch(), future)
    if is_cancelled:
        future.cancel()
    else:
        future.set_exception(SinkError("refused"))
    assert not sent.has_room
    assert sent.done()[0].has_failed


def test_the_store_counts_dropped_and_delivered_events() -> None:
    store = Store("stub", MemoryBacklog(20), None)
    assert all(store.put(batch(5, events)) for events in (1, 2, 3, 4))
    assert not store.put(batch(5))
    assert store.next() is not None
    assert store.drop_oldest() == 2  # the first is under way
    store.acknowledge([1])
    counts = store.delivery("slow")
    assert (counts.delivered, counts.spooled, counts.dropped, counts.complaint) == (1, 7, 2, "slow")
    assert store.full("no broker") == "stub: its queue is full, with 7 events that wait: no broker"
