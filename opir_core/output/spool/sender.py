"""The thread that sends a backlog over a transport, oldest first, and removes what is
acknowledged.
"""

import threading
import time
from contextlib import suppress

from opir_core.errors import SinkError
from opir_core.host.boundary import place_of_thread
from opir_core.host.watchdog import CallThread, OverdueError
from opir_core.interfaces.outputs import PartlySentError, Transport
from opir_core.interfaces.records import Batch
from opir_core.output.spool.batches import FullError
from opir_core.output.spool.policy import Closing, Parking, Policy
from opir_core.output.spool.sent_batches import Sent, SentBatches
from opir_core.output.spool.store import Store

#: Longest sleep of the sending thread, s; only retries on a full disk depend on it.
SLEEP_S = 0.25
#: Longest time, s, between two removals of acknowledged batches while batches are sent.
_REMOVAL_S = 0.1
#: Time, s, that a transport has to close.
_TRANSPORT_S = 2.0
#: Time, s, after which a transport's `close` has not kept to its own, and after which a `send` is
#: called trouble.
_LONGER_S = 8.0
TROUBLED_S = 5.0


class Sender:
    """Sends until it is closed; a permanent error is kept for the next `write` of the sink.

    `sent` belongs to the thread and, after its end, to `finish`; the store's lock guards what its
    other users change.
    """

    def __init__(self, store: Store, transport: Transport, policy: Policy) -> None:
        self.store = store
        self.transport = transport
        self.parking = Parking(policy)
        self.closing = Closing(policy, time.monotonic())
        self.sent = SentBatches()
        self._progress = 0
        #: Time of the monotonic clock at which the present `send` of the transport began.
        self._sending_since_s: float | None = None
        self.error: Exception | None = None
        self.wake = threading.Event()
        self._thread = threading.Thread(
            target=self._send_all, name=f"opir {store.name}", daemon=True
        )
        self._thread.start()

    @property
    def parked(self) -> str | None:
        """Why the transport refuses events for good, until it has acknowledged some, or the spool's
        disk fails.
        """
        return self.parking.reason or self.store.fault

    @property
    def trouble(self) -> str | None:
        """Why nothing gets through at the moment, or None: the transport's reason, or a `send` that
        does not return.
        """
        return self._overdue(TROUBLED_S) or self.transport.trouble

    def _overdue(self, after_s: float) -> str | None:
        since_s = self._sending_since_s
        # A `send` that raised has ended, and the thread with it.
        duration_s = (
            0.0 if since_s is None or not self._thread.is_alive() else time.monotonic() - since_s
        )
        if duration_s <= after_s:
            return None
        place = place_of_thread(self._thread.ident)
        return f"send of its transport has not returned for {duration_s:.0f} s: in {place}"

    @property
    def complaint(self) -> str | None:
        """The reason of a failed delivery, or None."""
        if self.error is None:
            return self.parked or self.store.damage
        if isinstance(self.error, SinkError):
            return str(self.error)
        return f"{self.store.name}: a defect: {self.error!r}"

    def raise_error(self) -> None:
        """Raise the error that ended the sending: a `SinkError`, or a defect of the transport as it
        is.
        """
        if isinstance(self.error, SinkError):
            raise SinkError(str(self.error)) from self.error
        if self.error is not None:
            raise self.error

    def close_by(self, deadline_s: float) -> None:
        """Stop waiting for acknowledgements in time for the transport to be closed by a
        deadline.
        """
        self.closing.end_at = deadline_s - _TRANSPORT_S
        self.wake.set()

    def finish(self) -> str | None:
        """Wait for acknowledgements and close the transport; return its trouble before that."""
        self.closing.since = time.monotonic()
        self.wake.set()
        while self._thread.is_alive() and not (
            time.monotonic() > self.closing.end_at and self._overdue(0.0)
        ):
            self._thread.join(SLEEP_S)
            if overdue := self._overdue(self.closing.policy.stall_s):
                self.error = self.error or SinkError(f"{self.store.name}: {overdue}")
                break
        trouble = self.trouble
        self.closing.is_over = True
        wait_s = min(_TRANSPORT_S, max(0.1, self.closing.end_at + _TRANSPORT_S - time.monotonic()))
        try:
            CallThread().result(
                lambda: self.transport.close(wait_s), wait_s + _LONGER_S, is_last=True
            )
        except SinkError as error:
            self.error = self.error or error
        except OverdueError as place:
            words = (
                f"close of its transport has not returned for {wait_s + _LONGER_S:.1f} s: in"
                f" {place}"
            )
            self.error = self.error or SinkError(f"{self.store.name}: {words}")
        try:
            self._remove_acknowledged()
        except SinkError as error:
            self.error = self.error or error
        return trouble

    def _send_all(self) -> None:
        try:
            while not self._is_done():
                self.wake.wait(SLEEP_S)
                self.wake.clear()
        except Exception as error:
            if not self.closing.is_over:
                self.error = error
        with self.store.room:
            self.store.room.notify_all()

    def _is_done(self) -> bool:
        """Remove acknowledged batches and send as many as there is room for; return whether sending
        is over.
        """
        self._remove_acknowledged()
        if self.transport.acknowledged != self._progress:  # a part of a batch is progress too
            self._progress = self.transport.acknowledged
            self.closing.acknowledged_at = time.monotonic()
        self._resume()
        remove_at = time.monotonic() + _REMOVAL_S
        while self._may_send() and (batch := self.store.next()):
            self._send(*batch)
            if time.monotonic() >= remove_at:  # also for a transport with a slow `send`
                self._remove_acknowledged()
                remove_at = time.monotonic() + _REMOVAL_S
        return self.closing.since is not None and (
            self.store.backlog.is_empty or self._is_stalled()
        )

    def _may_send(self) -> bool:
        return self.sent.has_room and self.parking.refused_from is None and not self._is_stalled()

    def _is_stalled(self) -> bool:
        """Return whether the sink is being closed and no longer waits for acknowledgements."""
        if self.closing.since is not None and self.parking.has_given_up and not self.sent:
            return True
        return self.closing.is_stalled(
            time.monotonic(), has_trouble=self.transport.trouble is not None
        )

    def _send(self, number: int, batch: Batch) -> None:
        self._sending_since_s = time.monotonic()
        future = self.transport.send(batch)
        self._sending_since_s = None
        self.sent.add(number, batch, future)
        future.add_done_callback(lambda _done: self.wake.set())

    def _remove_acknowledged(self) -> None:
        """Remove acknowledged batches from the backlog; raise the error of a batch that failed
        permanently.
        """
        done = self.sent.done()
        if not done:
            return
        failed = [sent for sent in done if sent.has_failed]
        try:
            self._acknowledge([sent.number for sent in done if not sent.has_failed])
        except FullError:  # no room to note it: it is noted later, or the batch is sent again
            return
        self.sent.remove(done)
        for sent in failed:
            self._refuse(sent)

    def _acknowledge(self, numbers: list[int]) -> None:
        if not numbers:
            return
        with self.store.room:
            self.store.acknowledge(numbers)
            self.closing.acknowledged_at = time.monotonic()
            self.parking.take()

    def _refuse(self, sent: Sent) -> None:
        """Park at a batch that failed, if the backlog outlives the process; otherwise raise the
        reason.
        """
        if sent.future.cancelled():
            if self.closing.since is not None:
                return
            error: BaseException | None = SinkError("the transport gave up without a reason")
        else:
            error = sent.future.exception()
        if isinstance(error, PartlySentError):
            with suppress(FullError):  # no room to note it: all of it is sent again
                self.store.keep(sent.number, error.rows)
            return
        if not isinstance(error, SinkError):
            raise error or AssertionError
        reason = f"{self.store.name}: {error}"
        if not self.store.backlog.outlives_the_process:
            raise SinkError(reason)
        with self.store.room:
            self.parking.refuse(sent.number, reason, time.monotonic())

    def _resume(self) -> None:
        """Go back to the first refused batch once no other is under way, and send from there when
        it is time.
        """
        first_number = self.parking.refused_from
        if first_number is None or self.sent:
            return
        with self.store.room:
            self.store.read_to = first_number - 1
            if not self.parking.resume(time.monotonic(), is_closing=self.closing.since is not None):
                return
        self.transport.retry()
