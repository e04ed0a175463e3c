"""Lanes: the messages of one partition on their way, in order, one batch at a time.

A batch goes out when the one before it is acknowledged, and not sooner. Whatever fails, nothing that comes after it has
been sent, so a new connection begins where the old one stopped and each sensor's events are first seen in order.
"""

import asyncio
from collections import deque
from collections.abc import Callable
from concurrent.futures import Future
from typing import Any

import numpy as np

from opir_core.interfaces.records import Batch

Rows = list[int]


class Shipment:
    """A parcel on its way: its messages, which of them are acknowledged, and the future that waits for all.

    Once all are acknowledged it holds none of them: a connection that was let go of is a cycle of references, which
    holds its last shipments until the garbage collector comes by.
    """

    def __init__(self, parcel: Batch, future: "Future[None]") -> None:
        self.future = future
        self._keys = tuple(key.encode() for key in parcel.keys)
        self._key_of = parcel.key_of
        self._messages = parcel.messages()
        self._headers = [
            ("content-type", parcel.content_type.encode()),
            ("schema-version", parcel.schema_version.encode()),
        ]
        self._open_rows = set(range(len(parcel)))

    def rows_by_partition(self, partition_of: Callable[[bytes], int]) -> dict[int, Rows]:
        """Return the rows that are not acknowledged, in order, by partition."""
        of_key = np.array([partition_of(key) for key in self._keys])
        of_row = of_key[self._key_of]
        rows = {int(each): np.flatnonzero(of_row == each).tolist() for each in np.unique(of_key)}
        if len(self._open_rows) == len(self._messages):
            return rows
        left = {each: [row for row in found if row in self._open_rows] for each, found in rows.items()}
        return {each: found for each, found in left.items() if found}

    def put(self, batch: Any, rows: Rows) -> int:
        """Append rows to aiokafka's batch and return how many it took."""
        keys, key_of, messages, headers = self._keys, self._key_of, self._messages, self._headers
        append = batch.append
        for place, row in enumerate(rows):
            if append(timestamp=None, key=keys[key_of[row]], value=messages[row], headers=headers) is None:
                return place
        return len(rows)

    def acknowledge(self, rows: Rows) -> bool:
        """Note that rows have arrived; return whether all have."""
        self._open_rows.difference_update(rows)
        if self._open_rows:
            return False
        self._messages = []
        if not self.future.done():
            self.future.set_result(None)
        return True


class Lane:
    """What waits for one partition; `has_some` is set while anything does."""

    def __init__(self) -> None:
        self._queue: deque[tuple[Shipment, Rows]] = deque()
        self.has_some = asyncio.Event()

    def add(self, shipment: Shipment, rows: Rows) -> None:
        """Queue rows of a shipment."""
        self._queue.append((shipment, rows))
        self.has_some.set()

    def fill(self, batch: Any) -> list[tuple[Shipment, Rows]]:
        """Move as much into a batch as it takes, and return what."""
        taken = []
        while self._queue:
            shipment, rows = self._queue.popleft()
            count = shipment.put(batch, rows)
            if count:
                taken.append((shipment, rows[:count]))
            if count < len(rows):
                self._queue.appendleft((shipment, rows[count:]))
                break
        if not self._queue:
            self.has_some.clear()
        return taken
