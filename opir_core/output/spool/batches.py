"""Batches of events, and the backlogs in which they wait until they are acknowledged.

For sinks that take windows, batches are columns (`columns.py`) and hold no messages.
"""

from collections import OrderedDict, deque
from collections.abc import Iterable, Iterator, Sequence
from concurrent.futures import Future
from typing import TYPE_CHECKING, Any, Protocol

import numpy as np
from numpy.typing import NDArray

from opir_core.arrays import ObjectArray
from opir_core.errors import SinkError
from opir_core.interfaces.outputs import Encoder, Sink, Transport
from opir_core.interfaces.records import Batch, Window, framed_messages
from opir_core.interfaces.sensors import Sensor
from opir_core.output.events.encoder_input import encoder_blocks, event_counter, only_encodable
from opir_core.output.spool.columns import CONTENT_TYPE, VERSION, Origin
from opir_core.output.spool.syncing import SINK_SYNC_S, SyncThread

if TYPE_CHECKING:
    from opir_core.output.heartbeats import Heartbeats

#: Events in a batch: about 600 kB of the default encoder's messages. A few batches fill a broker's
#: own batches for many partitions, and one is quickly read back from disk.
BATCH_EVENTS = 1024


class EncodedBatcher:
    """Cuts windows into batches of an encoder's messages, and of the heartbeats that follow them."""

    def __init__(
        self,
        encoder: Encoder,
        sensors: Sequence[Sensor],
        heartbeats: "Heartbeats | None" = None,
    ) -> None:
        self._encoder = encoder
        self.heartbeats = heartbeats
        self.events = event_counter(encoder)
        self._ids = np.array([sensor.id for sensor in sensors], dtype=object)

    def batches(self, window: Window) -> Iterator[Batch]:
        """Yield a window's events as batches, without those that have no message, then its
        heartbeats.
        """
        yield from self._encoded(window)
        if self.heartbeats is not None:
            yield from self.heartbeats.batches_until(window.end_s, window.commands)

    def _encoded(self, window: Window) -> Iterator[Batch]:
        for block in encoder_blocks(window, self._encoder):
            encodable = only_encodable(block, self._encoder)
            lines = self._encoder.encode(encodable)
            if len(encodable.tracks) and self._encoder.encodes_tracks:
                numbers, key = np.unique(encodable.tracks.track, return_inverse=True)
                yield from self._cut(lines, key, numbers.astype(str).astype(object))
            elif len(encodable.detections):
                yield from self._cut(lines, encodable.detections.sensor, self._ids)

    def _cut(self, lines: bytes, key: NDArray[Any], names: ObjectArray) -> Iterator[Batch]:
        """Yield the lines of a block as batches of at most `BATCH_EVENTS` events; `key` (n,) is a
        row of `names`.
        """
        batch = self._batch(lines, key, names)
        if len(batch) <= BATCH_EVENTS:
            yield batch
            return
        messages = framed_messages(lines)
        for start in range(0, len(key), BATCH_EVENTS):
            rows = slice(start, start + BATCH_EVENTS)
            yield self._batch(b"".join(messages[rows]), key[rows], names)

    def _batch(self, body: bytes, key: NDArray[Any], names: ObjectArray) -> Batch:
        used_keys, key_of = np.unique(key, return_inverse=True)
        return Batch(
            body=body,
            keys=tuple(names[used_keys].tolist()),
            key_of=key_of.astype(np.uint16),
            content_type=self._encoder.content_type,
            schema_version=self._encoder.schema_version,
        )


class FullError(Exception):
    """The backlog is full, or the disk refuses the batch; the words, if any, say why."""


class DamagedError(Exception):
    """A batch in a backlog is not what was put there; `number` is its number."""

    def __init__(self, number: int, reason: str) -> None:
        super().__init__(reason)
        self.number = number


class Backlog(Protocol):
    """Batches in order, numbered as they come; called from one thread at a time."""

    @property
    def waiting(self) -> int:
        """Number of events that wait."""

    @property
    def is_empty(self) -> bool:
        """Whether no batch waits, of events or of heartbeats."""

    @property
    def outlives_the_process(self) -> bool:
        """Whether batches left at closing are there for the next run."""

    def put(self, batch: Batch) -> None:
        """Add a batch; raise `FullError` if there is no room for it."""

    def after(self, number: int) -> tuple[int, Batch] | None:
        """Return the first batch with a higher number, with its number, or None."""

    def acknowledge(self, numbers: Iterable[int]) -> None:
        """Remove the batches with these numbers."""

    def keep(self, number: int, rows: Sequence[int]) -> None:
        """Remove the events of a batch but those in `rows`."""

    def drop_oldest(self, number: int) -> int | None:
        """Remove the first batch with a higher number and return its number of events; None if
        there is none.
        """

    @property
    def sync_fault(self) -> str:
        """Why the disk did not make batches last that it has taken, or ""."""

    def close(self) -> None:
        """Release the file, if there is one."""


class MemoryBacklog:
    """A `Backlog` in memory, with at most `max_bytes` of messages; the first batch always has
    room.
    """

    outlives_the_process = False
    sync_fault = ""

    def __init__(self, max_bytes: int) -> None:
        self._batches: OrderedDict[int, Batch] = OrderedDict()
        self._last = 0
        self._bytes = 0
        self._max_bytes = max_bytes
        self.waiting = 0

    @property
    def is_empty(self) -> bool:
        """Whether no batch waits."""
        return not self._batches

    def put(self, batch: Batch) -> None:
        """Add a batch; raise `FullError` if there is no room for it."""
        if self._batches and self._bytes + len(batch.body) > self._max_bytes:
            raise FullError
        self._last += 1
        self._batches[self._last] = batch
        self._bytes += len(batch.body)
        self.waiting += batch.events

    def after(self, number: int) -> tuple[int, Batch] | None:
        """Return the first batch with a higher number, with its number, or None."""
        if number + 1 in self._batches:
            return number + 1, self._batches[number + 1]
        return next(
            (
                (candidate, batch)
                for candidate, batch in self._batches.items()
                if candidate > number
            ),
            None,
        )

    def acknowledge(self, numbers: Iterable[int]) -> None:
        """Remove the batches with these numbers."""
        for number in numbers:
            batch = self._batches.pop(number)
            self._bytes -= len(batch.body)
            self.waiting -= batch.events

    def keep(self, number: int, rows: Sequence[int]) -> None:
        """Remove the events of a batch but those in `rows`."""
        batch = self._batches[number]
        remaining = self._batches[number].take(rows)
        self._batches[number] = remaining
        self._bytes -= len(batch.body) - len(remaining.body)
        self.waiting -= batch.events - remaining.events

    def drop_oldest(self, number: int) -> int | None:
        """Remove the first batch with a higher number and return its number of events; None if
        there is none.
        """
        oldest = self.after(number)
        if oldest is None:
            return None
        self.acknowledge([oldest[0]])
        return oldest[1].events

    def close(self) -> None:
        """Remove all batches."""
        self._batches.clear()


class WindowBatcher:
    """Cuts windows into batches of columns, each with the estimates that its detections refer to.

    The `encoder` of the sink decides what its events are, detections or tracks.
    """

    #: The sink that takes the windows writes them.
    heartbeats = None

    def __init__(self, encoder: Encoder, origin: Origin) -> None:
        self._encoder = encoder
        self._origin = origin
        self.events = event_counter(encoder)

    def batches(self, window: Window) -> Iterator[Batch]:
        """Yield a window as batches of columns."""
        for block in encoder_blocks(window, self._encoder):
            yield Batch(
                body=self._origin.packed(block),
                keys=("",),
                key_of=np.zeros(self.events(block), dtype=np.uint16),
                content_type=CONTENT_TYPE,
                schema_version=VERSION,
            )


#: Cuts windows into batches.
Batcher = EncodedBatcher | WindowBatcher


class WindowTransport(Transport):
    """A transport that writes batches of columns into a sink; batches are acknowledged once they
    are synced.
    """

    def __init__(self, sink: Sink, origin: Origin) -> None:
        self._sink = sink
        self._origin = origin
        self._written: deque[Future[None]] = deque()
        self._syncs = SyncThread(self._acknowledge, SINK_SYNC_S)

    def send(self, batch: Batch) -> "Future[None]":
        """Write the batch's window; the future is done after the sync."""
        future: Future[None] = Future()
        try:
            self._sink.write(self._origin.unpacked(batch))
        except SinkError as error:
            future.set_exception(error)
        else:
            self._written.append(future)
            self._syncs.note_write()
        return future

    def _acknowledge(self) -> None:
        """Sync the sink, and acknowledge what was written before."""
        written = [self._written.popleft() for _ in range(len(self._written))]
        try:
            self._sink.sync()
        except Exception as error:
            for future in written:
                future.set_exception(error)
        else:
            for future in written:
                future.set_result(None)

    def close(self, wait_s: float) -> None:
        """Acknowledge what was written last, and close the sink."""
        self._syncs.stop()
        self._acknowledge()
        if complaint := self._sink.close().complaint:
            raise SinkError(complaint)
