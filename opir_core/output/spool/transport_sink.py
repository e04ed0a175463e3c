"""The sink that sends batches from a backlog over a transport and removes those that are
acknowledged.

`write` encodes events into the backlog and waits for no network. A thread sends the batches, oldest
first and a bounded number of bytes ahead of the acknowledgements. Events of an earlier run are sent
before those of this run, so each key's events keep their order.

A final error of the transport ends a sink without a spool. One with a spool is parked: it takes
events as before, and sends them again after a pause, which grows, or on request.
"""

import logging
import time
from contextlib import suppress

from attrs import evolve

from opir_core.errors import SinkError
from opir_core.interfaces.outputs import Delivery, Sink, Transport
from opir_core.interfaces.records import Batch, Window
from opir_core.output.spool.batches import Backlog, Batcher
from opir_core.output.spool.policy import Policy
from opir_core.output.spool.salvage import Salvage
from opir_core.output.spool.sender import SLEEP_S, Sender
from opir_core.output.spool.store import Store
from opir_core.scene.scene import DROP_NEWEST, DROP_OLDEST, WAIT

_log = logging.getLogger(__name__)


class TransportSink(Sink):
    """A sink with a transport and a backlog; events already in the backlog are sent first."""

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
        self._batcher = batcher
        self._policy = policy
        self._store = Store(name, backlog, damage)
        self._sender = Sender(self._store, transport, policy)

    def write(self, window: Window) -> None:
        """Put the window's events into the backlog; raise `SinkError` once the transport or the
        backlog has failed.
        """
        encoded = 0
        for batch in self._batcher.batches(window):
            encoded += batch.events
            self._queue(batch)
        with self._store.room:
            self._store.books.withheld += self._batcher.events(window) - encoded
            self._sender.raise_error()

    def _queue(self, batch: Batch) -> None:
        with self._store.room:
            self._put(batch)
        self._sender.wake.set()

    @property
    def takes_quiet_windows(self) -> bool:
        """Whether heartbeats follow windows without events."""
        return self._batcher.heartbeats is not None

    @property
    def outlives_the_process(self) -> bool:
        """Whether written events survive the end of the process, however it ends."""
        return self._store.backlog.outlives_the_process

    def delivery_so_far(self) -> Delivery:
        """Return the counts so far; `spooled` are the events that wait, in memory or on disk."""
        with self._store.room:
            return self._store.delivery(self._sender.complaint or self._sender.trouble)

    @property
    def parked(self) -> str | None:
        """Why the transport refuses events for good, until it has acknowledged some, or the spool's
        disk fails.

        None without a spool.
        """
        return self._sender.parked

    @property
    def trouble(self) -> str | None:
        """Why nothing gets through at the moment, or None."""
        return self._sender.trouble

    @property
    def attempts(self) -> int:
        """Number of failed attempts of the transport since the last success."""
        return self._sender.transport.attempts

    def retry(self) -> bool:
        """Send at once what was refused; return whether the sink was parked."""
        with self._store.room:
            is_parked = self._sender.parking.retry()
        self._sender.wake.set()
        return is_parked

    def close_by(self, deadline_s: float) -> None:
        """Be closed by `deadline_s` of the monotonic clock, delivered or not; callable from any
        thread.
        """
        self._sender.close_by(deadline_s)

    def close(self) -> Delivery:
        """Wait for acknowledgements, as long as the policy allows, and return the counts."""
        if self._batcher.heartbeats is not None:
            last_batches = list(self._batcher.heartbeats.last_batches())
            with suppress(Exception):  # the counts say why there is no room, or no transport
                for batch in last_batches:
                    self._queue(batch)
        trouble = self._sender.finish()
        delivery = self._final(trouble)
        if delivery.spooled and not delivery.complaint:
            why = trouble or "no acknowledgement came in time"
            _log.warning(
                "%s: %d events wait in its spool: %s", self._store.name, delivery.spooled, why
            )
        self._store.backlog.close()
        error = self._sender.error
        if error is not None and not isinstance(error, SinkError):
            raise error
        return delivery

    def _final(self, trouble: str | None) -> Delivery:
        counts = self._store.delivery(self._sender.complaint)
        if self.outlives_the_process or not counts.spooled:
            return counts
        reason = counts.complaint or f"{self._store.name}: {trouble or 'no acknowledgement came'}"
        hint = "" if counts.complaint else "; a spool would keep what is lost"
        return evolve(
            counts, spooled=0, dropped=counts.dropped + counts.spooled, complaint=reason + hint
        )

    def _put(self, batch: Batch) -> None:
        """Put a batch into the backlog; if that is full, wait or drop as the policy says. The lock
        is held.
        """
        store = self._store
        when_full = self._policy.when_full
        self._sender.raise_error()
        give_up_at = time.monotonic() + self._policy.wait_s
        waited = False
        while not store.put(batch):
            if when_full == DROP_OLDEST and store.drop_oldest() is not None:
                continue
            left_s = min(give_up_at, self._sender.closing.end_at) - time.monotonic()
            if when_full != WAIT or left_s <= 0.0:
                store.books.dropped += batch.events
                if when_full in (DROP_OLDEST, DROP_NEWEST):
                    return
                raise SinkError(store.full(self._sender.trouble))
            self.waits += not waited
            waited = True
            store.room.wait(min(SLEEP_S, left_s))
            self._sender.raise_error()
