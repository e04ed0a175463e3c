"""Lanes: the queued messages of a partition, sent in order, one batch at a time.

A batch is sent after the acknowledgement of the one before. After an error no later message has
been sent, so a new connection starts where the old one stopped, and the first arrivals of each
sensor's events are in order.
"""

import asyncio
import sys
from collections import deque
from collections.abc import Callable
from concurrent.futures import Future
from typing import Any

import numpy as np

from opir_core.plugin import Batch, PartlySentError
from opir_kafka.telemetry import trace_headers

Rows = list[int]
Frame = Callable[[bytes], bytes]


class Shipment:
    """A batch that is being sent: its messages, those not yet acknowledged, and the future of the
    whole batch.

    It drops its messages once all are acknowledged: a closed connection is a reference cycle that
    holds its last shipments until the next garbage collection.
    """

    def __init__(self, batch: Batch, future: "Future[None]") -> None:
        self.future = future
        self._keys = tuple(key.encode() for key in batch.keys)
        self._key_of = batch.key_of
        self._messages = batch.messages()
        self._headers = [
            ("content-type", batch.content_type.encode()),
            ("schema-version", batch.schema_version.encode()),
            *trace_headers(batch, future),
        ]
        self._open_rows = set(range(len(batch)))

    def rows_by_partition(self, partition_of: Callable[[bytes], int]) -> dict[int, Rows]:
        """Return the unacknowledged rows, in order, by partition."""
        of_key = np.array([partition_of(key) for key in self._keys])
        of_row = of_key[self._key_of]
        rows_of = {
            number: np.flatnonzero(of_row == number).tolist()
            for number in np.unique(of_key).tolist()
        }
        if len(self._open_rows) == len(self._messages):
            return rows_of
        open_rows = {
            number: [row for row in rows if row in self._open_rows]
            for number, rows in rows_of.items()
        }
        return {number: rows for number, rows in open_rows.items() if rows}

    def put(self, batch: Any, rows: Rows, frame: Frame | None) -> int:
        """Append rows, framed, to aiokafka's batch and return the number that fit."""
        keys = self._keys
        key_of = self._key_of
        messages = self._messages
        headers = self._headers
        append = batch.append
        for place, row in enumerate(rows):
            key = keys[key_of[row]]
            value = messages[row] if frame is None else frame(messages[row])
            if append(timestamp=None, key=key, value=value, headers=headers) is None:
                return place
        return len(rows)

    def acknowledge(self, rows: Rows) -> bool:
        """Mark rows as acknowledged: true if all rows are."""
        self._open_rows.difference_update(rows)
        if self._open_rows:
            return False
        self._messages = []
        if not self.future.done():
            self.future.set_result(None)
        return True

    def give_up(self) -> None:
        """End the future: cancelled, or with the rows that are not acknowledged if others are."""
        if len(self._open_rows) == len(self._messages) or self.future.done():
            self.future.cancel()
        else:
            self.future.set_exception(PartlySentError(sorted(self._open_rows)))


class Lane:
    """The queue of a partition; `has_messages` is set while it is not empty. A `frame` makes the
    values of Kafka's messages from those of the encoder.
    """

    def __init__(self, frame: Frame | None = None) -> None:
        self._frame = frame
        self._queue: deque[tuple[Shipment, Rows]] = deque()
        self.has_messages = asyncio.Event()

    def add(self, shipment: Shipment, rows: Rows) -> None:
        """Queue rows of a shipment."""
        self._queue.append((shipment, rows))
        self.has_messages.set()

    def fill(self, batch: Any, capacity: int = sys.maxsize) -> list[tuple[Shipment, Rows]]:
        """Move as many messages as fit into aiokafka's batch, at most `capacity`; return their
        shipments and rows.
        """
        moved = []
        while self._queue:
            shipment, rows = self._queue.popleft()
            count = shipment.put(batch, rows[:capacity], self._frame)
            capacity -= count
            if count:
                moved.append((shipment, rows[:count]))
            if count < len(rows):
                self._queue.appendleft((shipment, rows[count:]))
                break
        if not self._queue:
            self.has_messages.clear()
        return moved
