"""The sink that sends batches from a backlog over a transport and removes those that are acknowledged.

`write` encodes events into the backlog and waits for no network. A thread sends the batches, oldest first and a bounded
number of bytes ahead of the acknowledgements. Events of an earlier run are sent before those of this run, so each key's
events keep their order.

A final error of the transport ends a sink without a spool. One with a spool is parked: it takes events as before, and
sends them again after a pause, which grows, or on request.
"""

import math
import threading
import time
from collections import deque
from concurrent.futures import Future

from attrs import evolve, frozen

from opir_core.errors import SinkError
from opir_core.interfaces.outputs import Delivery, Sink, Transport
from opir_core.interfaces.records import Batch, Window
from opir_core.output.spool.batches import (
    Backlog,
    Batcher,
    DamagedError,
    FullError,
)
from opir_core.output.spool.salvage import Salvage
from opir_core.scene.scene import DROP_NEWEST, DROP_OLDEST, WAIT

#: Maximum bytes of messages that are sent and not yet acknowledged.
AHEAD_BYTES = 8 << 20
#: Longest sleep of the sending thread, s; only retries on a full disk depend on it.
_SLEEP_S = 0.25
#: Longest time, s, between two removals of acknowledged batches while batches are sent.
_REMOVAL_S = 0.1
#: Time, s, that a transport has to close.
_TRANSPORT_S = 2.0


@frozen(kw_only=True)
class Policy:
    """What is dropped when the backlog is full, how long `wait` waits, s, and when closing stops waiting.

    Closing waits for acknowledgements until none has come for `stall_s`. A parked sink tries again after `retry_s`,
    then after twice as long each time, up to `longest_retry_s`.
    """

    when_full: str = WAIT
    wait_s: float = 30.0
    stall_s: float = 10.0
    retry_s: float = 5.0
    longest_retry_s: float = 300.0


@frozen(eq=False)
class _Sent:
    number: int
    size: int
    future: "Future[None]"


class TransportSink(Sink):
    """A sink with a transport and a backlog; what the backlog holds already is sent first.

    The lock guards the backlog and the counts and is never held while the transport works. What is sent and not yet
    acknowledged belongs to the sending thread and, after its end, to `close`.
    """

    #: How often `write` has waited for room.
    waits = 0

    def __init__(
        self,
        name: str,
        transport: Transport,
        backlog: Backlog,
        batcher: Batcher,
        policy: Policy,
        damage: Salvage | None = None,
    ) -> None:
        self._name = name
        self._transport = transport
        self._backlog = backlog
        self._batcher = batcher
        self._policy = policy
        self._room = threading.Condition()
        self._wake = threading.Event()
        self._sent: deque[_Sent] = deque()
        self._ahead_bytes = 0
        self._last_number = 0
        # Events of an earlier run that were lost with a damaged spool were recovered and dropped.
        self._dropped = 0 if damage is None else damage.state.lost_events
        self._damage = None if damage is None else f"{name}: the spool {getattr(backlog, 'path', '')}: {damage}"
        self._recovered = backlog.waiting + self._dropped
        self._delivered = self._withheld = 0
        #: Why the disk did not take the last bytes for the backlog, and why it does not let it be read.
        self._disk = self._unread = ""
        self._error: Exception | None = None
        #: Why the transport refuses batches for good, the first of these, and when, after what pause, to try again.
        self._parked: str | None = None
        self._refused_from: int | None = None
        self._retry_at, self._pause_s = math.inf, 0.0
        self._is_last_try = False
        self._closing_since: float | None = None
        self._end_at = math.inf
        self._acknowledged_at = time.monotonic()
        self._thread = threading.Thread(target=self._send_all, name=f"opir {name}", daemon=True)
        self._thread.start()

    def write(self, window: Window) -> None:
        """Put the window's events into the backlog; raise `SinkError` once the transport or the backlog has failed."""
        encoded = 0
        for batch in self._batcher.batches(window):
            encoded += len(batch)
            with self._room:
                self._put(batch)
            self._wake.set()
        with self._room:
            self._withheld += self._batcher.events(window) - encoded
            self._raise_error()

    @property
    def outlives_the_process(self) -> bool:
        """Whether written events survive the end of the process, however it ends."""
        return self._backlog.outlives_the_process

    def delivery_so_far(self) -> Delivery:
        """Return the counts so far; `spooled` are the events that wait, in memory or on disk."""
        with self._room:
            return self._delivery(self._failure() or self._transport.trouble)

    @property
    def parked(self) -> str | None:
        """Why the transport refuses events for good, until it has acknowledged some, or the spool's disk fails.

        None without a spool.
        """
        return self._parked or self._failure_of_disk()

    def retry(self) -> bool:
        """Send at once what was refused; return whether the sink was parked."""
        with self._room:
            is_parked, self._retry_at = self._parked is not None, -math.inf
        self._wake.set()
        return is_parked

    def close_by(self, deadline_s: float) -> None:
        """Be closed by `deadline_s` of the monotonic clock, delivered or not; callable from any thread."""
        self._end_at = deadline_s - _TRANSPORT_S
        self._wake.set()

    def close(self) -> Delivery:
        """Wait for acknowledgements, as long as the policy allows, and return the counts."""
        self._closing_since = time.monotonic()
        self._wake.set()
        self._thread.join()
        trouble = self._transport.trouble
        self._transport.close(min(_TRANSPORT_S, max(0.1, self._end_at + _TRANSPORT_S - time.monotonic())))
        try:
            self._remove_acknowledged()
        except SinkError as error:
            self._error = self._error or error
        delivery = self._final(trouble)
        self._backlog.close()
        if self._error is not None and not isinstance(self._error, SinkError):
            raise self._error
        return delivery

    def _final(self, trouble: str | None) -> Delivery:
        counts = self._delivery(self._failure())
        if self._backlog.outlives_the_process or not counts.spooled:
            return counts
        reason = counts.complaint or f"{self._name}: {trouble or 'no acknowledgement came'}"
        hint = "" if counts.complaint else "; a spool would keep what is lost"
        return evolve(counts, spooled=0, dropped=counts.dropped + counts.spooled, complaint=reason + hint)

    def _delivery(self, complaint: str | None) -> Delivery:
        waiting = self._backlog.waiting
        return Delivery(self._delivered, waiting, self._dropped, self._withheld, self._recovered, complaint)

    def _put(self, batch: Batch) -> None:
        """Put a batch into the backlog; if that is full, wait or drop as the policy says. The lock is held."""
        self._raise_error()
        give_up_at, waited = time.monotonic() + self._policy.wait_s, False
        while not self._is_put(batch):
            lost = self._drop_oldest() if self._policy.when_full == DROP_OLDEST else 0
            self._dropped += lost
            if lost:
                continue
            if self._policy.when_full in (DROP_OLDEST, DROP_NEWEST):
                self._dropped += len(batch)
                return
            left_s = min(give_up_at, self._end_at) - time.monotonic()
            if self._policy.when_full != WAIT or left_s <= 0.0:
                self._dropped += len(batch)
                raise SinkError(self._full())
            self.waits += not waited
            waited = True
            self._room.wait(min(_SLEEP_S, left_s))
            self._raise_error()

    def _is_put(self, batch: Batch) -> bool:
        try:
            self._backlog.put(batch)
        except FullError as error:
            self._disk = str(error)
            return False
        self._disk = ""
        return True

    def _drop_oldest(self) -> int:
        try:
            return self._backlog.drop_oldest(self._last_number)
        except FullError:  # the disk itself is full, and deleting needs room too
            return 0

    def _full(self) -> str:
        place = getattr(self._backlog, "path", None)
        trouble = self._disk or self._transport.trouble
        state = "cannot be written" if self._disk else "is full"
        return (
            f"{self._name}: {f'its spool {place}' if place else 'its queue'} {state}, with"
            f" {self._backlog.waiting} events that wait{f': {trouble}' if trouble else ''}"
        )

    def _failure(self) -> str | None:
        if self._error is None:
            return self.parked or self._damage
        if isinstance(self._error, SinkError):
            return str(self._error)
        return f"{self._name}: a defect: {self._error!r}"

    def _failure_of_disk(self) -> str | None:
        if not self._disk:
            return self._unread or None
        return f"{self._name}: the spool {getattr(self._backlog, 'path', '')} cannot be written: {self._disk}"

    def _raise_error(self) -> None:
        """Raise the error that ended the sending: a `SinkError`, or a defect of the transport as it is."""
        if isinstance(self._error, SinkError):
            raise SinkError(str(self._error)) from self._error
        if self._error is not None:
            raise self._error

    def _send_all(self) -> None:
        """Send batches until the sink is closed; a permanent error is kept for the next `write`."""
        try:
            while not self._is_done():
                self._wake.wait(_SLEEP_S)
                self._wake.clear()
        except Exception as error:
            self._error = error
        with self._room:
            self._room.notify_all()

    def _is_done(self) -> bool:
        """Remove acknowledged batches and send as many as there is room for; return whether sending is over."""
        self._remove_acknowledged()
        self._send_again()
        remove_at = time.monotonic() + _REMOVAL_S
        while self._may_send() and (batch := self._next()):
            self._send(*batch)
            if time.monotonic() >= remove_at:  # also for a transport with a slow `send`
                self._remove_acknowledged()
                remove_at = time.monotonic() + _REMOVAL_S
        return self._closing_since is not None and (not self._backlog.waiting or self._is_stalled())

    def _may_send(self) -> bool:
        if self._sent and _has_failed(self._sent[-1].future):  # what is behind it would overtake it
            return False
        return self._ahead_bytes < AHEAD_BYTES and self._refused_from is None and not self._is_stalled()

    def _is_stalled(self) -> bool:
        """Return whether the sink is being closed and no longer waits for acknowledgements."""
        if self._closing_since is None:
            return False
        if self._refused_from is not None and self._is_last_try and not self._sent:
            return True
        stall_at = max(self._closing_since, self._acknowledged_at) + self._policy.stall_s
        return time.monotonic() >= min(self._end_at, stall_at)

    def _next(self) -> tuple[int, Batch] | None:
        """Return the next batch to send, None if there is none or it cannot be read now; skip those that are damaged.

        What is damaged stays in the file, until the next start sets that aside.
        """
        with self._room:
            while True:
                try:
                    numbered = self._backlog.after(self._last_number)
                except FullError as error:  # what the disk keeps is sent later
                    place, why = getattr(self._backlog, "path", ""), str(error) or "its disk is full"
                    if self._backlog.waiting:
                        self._unread = f"{self._name}: the spool {place} cannot be read: {why}"
                    return None
                except DamagedError as error:
                    self._damage, self._last_number = f"{self._name}: {error}", error.number
                    continue
                self._unread = ""
                if numbered is not None:
                    self._last_number = numbered[0]
                return numbered

    def _send(self, number: int, batch: Batch) -> None:
        future = self._transport.send(batch)
        self._sent.append(_Sent(number, len(batch.body), future))
        self._ahead_bytes += len(batch.body)
        future.add_done_callback(lambda _done: self._wake.set())

    def _remove_acknowledged(self) -> None:
        """Remove acknowledged batches from the backlog; raise the error of a batch that failed permanently."""
        done = [sent for sent in self._sent if sent.future.done()]
        if not done:
            return
        failed = [sent for sent in done if _has_failed(sent.future)]
        try:
            self._acknowledge([sent.number for sent in done if sent not in failed])
        except FullError:  # no room to note it: it is noted later, or the batch is sent again
            return
        self._sent = deque(sent for sent in self._sent if sent not in done)
        self._ahead_bytes -= sum(sent.size for sent in done)
        for sent in failed:
            if not sent.future.cancelled():
                error = sent.future.exception()
                if not isinstance(error, SinkError):
                    raise error or AssertionError
                self._refuse(sent.number, f"{self._name}: {error}")
            elif self._closing_since is None:
                self._refuse(sent.number, f"{self._name}: the transport gave up without a reason")

    def _refuse(self, number: int, reason: str) -> None:
        """Park a sink whose backlog outlives the process, at the first batch that was refused; end any other."""
        if not self.outlives_the_process:
            raise SinkError(reason)
        with self._room:
            if self._refused_from is None:
                self._pause_s = min(max(self._policy.retry_s, 2.0 * self._pause_s), self._policy.longest_retry_s)
                self._retry_at = time.monotonic() + self._pause_s
            self._parked = reason
            self._refused_from = min(number, number if self._refused_from is None else self._refused_from)

    def _send_again(self) -> None:
        """Go back to the first refused batch once no other is under way, and send from there when it is time.

        Until some batch is acknowledged the sink stays parked. When it is closed, it tries once more.
        """
        if self._refused_from is None or self._sent:
            return
        with self._room:
            self._last_number = self._refused_from - 1
            is_closing = self._closing_since is not None
            if (is_closing and self._is_last_try) or (not is_closing and time.monotonic() < self._retry_at):
                return
            self._is_last_try, self._refused_from = is_closing, None
        self._transport.retry()

    def _acknowledge(self, numbers: list[int]) -> None:
        if not numbers:
            return
        with self._room:
            before = self._backlog.waiting
            self._backlog.acknowledge(numbers)
            self._delivered += before - self._backlog.waiting
            self._acknowledged_at = time.monotonic()
            self._parked, self._pause_s = None, 0.0
            self._unread = self._unread if self._backlog.waiting else ""
            self._room.notify_all()


def _has_failed(future: Future[None]) -> bool:
    return future.done() and (future.cancelled() or future.exception() is not None)
