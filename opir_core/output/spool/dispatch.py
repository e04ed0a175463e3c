"""Dispatch: the sink that feeds a carrier from a backlog, and strikes off what the carrier says has arrived.

`write` encodes and puts events into the backlog, and waits for no network. A thread takes them from there to the
carrier, a bounded number of bytes ahead of what is acknowledged, and oldest first: what an earlier run left comes
before what this one adds, so each key's events keep their order.
"""

import math
import threading
import time
from collections import deque
from concurrent.futures import Future

from attrs import evolve, frozen

from opir_core.errors import SinkError
from opir_core.interfaces.protocols import Delivery, Transport
from opir_core.interfaces.records import Batch, Window
from opir_core.output.spool.batches import Backlog, FullError, Packing
from opir_core.scene.spool_settings import DROP_NEWEST, DROP_OLDEST, WAIT

#: Bytes of messages handed to a carrier and not yet acknowledged.
AHEAD_BYTES = 8 << 20
#: How long the feeding thread sleeps when nothing wakes it; only retries on a full disk depend on it.
_NAP_S = 0.25
#: How long what has arrived may go without being struck off while more is handed over.
_SETTLE_S = 0.1
#: How long a carrier may take to let go.
_CARRIER_S = 2.0


@frozen(kw_only=True)
class Policy:
    """What gives way when the backlog is full, and how long `wait` waits.

    Closing waits for acknowledgements until none has come for `stall_s`.
    """

    when_full: str = WAIT
    wait_s: float = 30.0
    stall_s: float = 10.0


@frozen(eq=False)
class _Sent:
    number: int
    size: int
    future: "Future[None]"


class Dispatch:
    """A sink of a carrier and a backlog; what the backlog holds when it is made is sent first.

    The lock is held for the backlog and the counts, never while the carrier works: only the feeding thread and, after
    it has ended, `close` touch what is sent.
    """

    def __init__(self, name: str, carrier: Transport, backlog: Backlog, packing: Packing, policy: Policy) -> None:
        self._name = name
        self._carrier = carrier
        self._backlog = backlog
        self._packing = packing
        self._policy = policy
        self._room = threading.Condition()
        self._wake = threading.Event()
        self._sent: deque[_Sent] = deque()
        self._ahead_bytes = 0
        self._handed = 0
        self._recovered = backlog.waiting
        self._delivered = self._dropped = self._withheld = 0
        #: How often `write` had to wait for room.
        self.waits = 0
        self._error: Exception | None = None
        self._closing_since: float | None = None
        self._end_at = math.inf
        self._arrived_at = time.monotonic()
        self._thread = threading.Thread(target=self._feed, name=f"opir {name}", daemon=True)
        self._thread.start()

    def write(self, window: Window) -> None:
        """Put the window's events into the backlog; raise `SinkError` once the carrier or the backlog has failed."""
        found = 0
        for parcel in self._packing.parcels(window):
            found += len(parcel)
            with self._room:
                self._put(parcel)
            self._wake.set()
        with self._room:
            self._withheld += len(window.detections) - found
            self._refuse_if_failed()

    @property
    def outlives_the_process(self) -> bool:
        """Whether what `write` has taken survives the end of the process, however it comes."""
        return self._backlog.outlives_the_process

    def delivery_so_far(self) -> Delivery:
        """Return what has become of the events so far; `spooled` are those that wait, in memory or on disk."""
        with self._room:
            return self._standing(self._failure() or self._carrier.trouble)

    def close_by(self, deadline_s: float) -> None:
        """Be closed by `deadline_s` of the steady clock, whatever has not arrived; callable from any thread."""
        self._end_at = deadline_s - _CARRIER_S
        self._wake.set()

    def close(self) -> Delivery:
        """Wait for acknowledgements, as long as the policy says, and say what became of the events."""
        self._closing_since = time.monotonic()
        self._wake.set()
        self._thread.join()
        trouble = self._carrier.trouble
        self._carrier.close(min(_CARRIER_S, max(0.1, self._end_at + _CARRIER_S - time.monotonic())))
        try:
            self._settle()
        except SinkError as error:
            self._error = self._error or error
        delivery = self._final(trouble)
        self._backlog.close()
        if self._error is not None and not isinstance(self._error, SinkError):
            raise self._error
        return delivery

    def _final(self, trouble: str | None) -> Delivery:
        told = self._standing(self._failure())
        if self._backlog.outlives_the_process or not told.spooled:
            return told
        why = told.complaint or f"{self._name}: {trouble or 'no acknowledgement came'}"
        hint = "" if told.complaint else "; a spool would keep what is lost"
        return evolve(told, spooled=0, dropped=told.dropped + told.spooled, complaint=why + hint)

    def _standing(self, complaint: str | None) -> Delivery:
        waiting = self._backlog.waiting
        return Delivery(self._delivered, waiting, self._dropped, self._withheld, self._recovered, complaint)

    def _put(self, parcel: Batch) -> None:
        """Put a parcel into the backlog, or do what the policy says when that is full; holds the lock."""
        self._refuse_if_failed()
        give_up_at, waited = time.monotonic() + self._policy.wait_s, False
        while not self._is_put(parcel):
            lost = self._dropped_oldest() if self._policy.when_full == DROP_OLDEST else 0
            self._dropped += lost
            if lost:
                continue
            if self._policy.when_full in (DROP_OLDEST, DROP_NEWEST):
                self._dropped += len(parcel)
                return
            left_s = min(give_up_at, self._end_at) - time.monotonic()
            if self._policy.when_full != WAIT or left_s <= 0.0:
                self._dropped += len(parcel)
                raise SinkError(self._full())
            self.waits += not waited
            waited = True
            self._room.wait(min(_NAP_S, left_s))
            self._refuse_if_failed()

    def _is_put(self, parcel: Batch) -> bool:
        try:
            self._backlog.put(parcel)
        except FullError:
            return False
        return True

    def _dropped_oldest(self) -> int:
        try:
            return self._backlog.drop_oldest(self._handed)
        except FullError:  # the disk itself is full: forgetting takes room too
            return 0

    def _full(self) -> str:
        place = getattr(self._backlog, "path", None)
        trouble = self._carrier.trouble
        return (
            f"{self._name}: {f'its spool {place}' if place else 'its queue'} is full, with"
            f" {self._backlog.waiting} events that wait{f': {trouble}' if trouble else ''}"
        )

    def _failure(self) -> str | None:
        if self._error is None or isinstance(self._error, SinkError):
            return None if self._error is None else str(self._error)
        return f"{self._name}: a defect: {self._error!r}"

    def _refuse_if_failed(self) -> None:
        """Raise what stopped the feeding: a `SinkError`, or as it is what is a defect of the carrier."""
        if isinstance(self._error, SinkError):
            raise SinkError(str(self._error)) from self._error
        if self._error is not None:
            raise self._error

    def _feed(self) -> None:
        """Move parcels until closing is over; what fails for good is kept for the next `write`."""
        try:
            while not self._step():
                self._wake.wait(_NAP_S)
                self._wake.clear()
        except Exception as error:
            self._error = error
        with self._room:
            self._room.notify_all()

    def _step(self) -> bool:
        """Strike off what arrived, hand over what there is room for; return whether there is nothing left to do."""
        self._settle()
        settle_at = time.monotonic() + _SETTLE_S
        while self._ahead_bytes < AHEAD_BYTES and not self._is_to_leave() and (found := self._next()):
            self._hand_over(*found)
            if time.monotonic() >= settle_at:  # of a carrier that takes its time in `send` itself, too
                self._settle()
                settle_at = time.monotonic() + _SETTLE_S
        return self._closing_since is not None and (not self._backlog.waiting or self._is_out_of_time())

    def _is_to_leave(self) -> bool:
        return self._closing_since is not None and self._is_out_of_time()

    def _is_out_of_time(self) -> bool:
        since = self._closing_since or 0.0
        return time.monotonic() >= min(self._end_at, max(since, self._arrived_at) + self._policy.stall_s)

    def _next(self) -> tuple[int, Batch] | None:
        with self._room:
            found = self._backlog.after(self._handed)
            if found is not None:
                self._handed = found[0]
            return found

    def _hand_over(self, number: int, parcel: Batch) -> None:
        future = self._carrier.send(parcel)
        self._sent.append(_Sent(number, len(parcel.body), future))
        self._ahead_bytes += len(parcel.body)
        future.add_done_callback(lambda _done: self._wake.set())

    def _settle(self) -> None:
        """Strike off what is acknowledged; raise the error of a parcel that failed for good."""
        done = [sent for sent in self._sent if sent.future.done()]
        if not done:
            return
        failed = [sent for sent in done if sent.future.cancelled() or sent.future.exception() is not None]
        try:
            self._strike([sent.number for sent in done if sent not in failed])
        except FullError:  # no room to note it: it is noted later, or the parcel is sent again
            return
        self._sent = deque(sent for sent in self._sent if sent not in done)
        self._ahead_bytes -= sum(sent.size for sent in done)
        for sent in failed:
            self._raise_failure(sent.future)

    def _strike(self, numbers: list[int]) -> None:
        if not numbers:
            return
        with self._room:
            before = self._backlog.waiting
            self._backlog.acknowledge(numbers)
            self._delivered += before - self._backlog.waiting
            self._arrived_at = time.monotonic()
            self._room.notify_all()

    def _raise_failure(self, future: "Future[None]") -> None:
        if not future.cancelled():
            error = future.exception()
            raise SinkError(f"{self._name}: {error}") if isinstance(error, SinkError) else error or AssertionError
        if self._closing_since is None:
            raise SinkError(f"{self._name}: gave up without saying why")
