"""Backlogs: where parcels wait until they are acknowledged.

Parcels: encoded events on their way out, each with the key that its order is kept by.
"""

from collections import OrderedDict
from collections.abc import Iterable, Iterator, Sequence
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from opir_core.interfaces.protocols import Encoder, Sensor
from opir_core.interfaces.records import Batch, Window
from opir_core.output.events.blocks import only_encodable, window_blocks

#: Events in a parcel: some 600 kB of the default encoder's, so that a few parcels make a broker's batch for each of
#: many partitions, and one is quickly read back from disk.
PARCEL_EVENTS = 1024


class Packing(Protocol):
    """Makes parcels of windows."""

    def parcels(self, window: Window) -> Iterator[Batch]:
        """Yield a window's events as parcels, in order."""


class Packer:
    """Makes parcels of an encoder's messages."""

    def __init__(self, encoder: Encoder, sensors: Sequence[Sensor]) -> None:
        self._encoder = encoder
        self._ids = np.array([sensor.id for sensor in sensors], dtype=object)

    def parcels(self, window: Window) -> Iterator[Batch]:
        """Yield a window's events as parcels; those that the encoder has no message for are left out."""
        for block in window_blocks(window):
            kept = only_encodable(block, self._encoder)
            lines = self._encoder.encode(kept)
            if len(kept.detections):
                yield from self._cut(lines, kept.detections.sensor)

    def _cut(self, lines: bytes, sensor: NDArray[np.int32]) -> Iterator[Batch]:
        """Yield parcels of at most `PARCEL_EVENTS` events of a block's lines."""
        whole = self._parcel(lines, sensor)
        if len(whole) <= PARCEL_EVENTS:
            yield whole
            return
        messages = whole.messages()
        for first in range(0, len(sensor), PARCEL_EVENTS):
            part = slice(first, first + PARCEL_EVENTS)
            yield self._parcel(b"\n".join([*messages[part], b""]), sensor[part])

    def _parcel(self, body: bytes, sensor: NDArray[np.int32]) -> Batch:
        found, key_of = np.unique(sensor, return_inverse=True)
        return Batch(
            body=body,
            keys=tuple(self._ids[found].tolist()),
            key_of=key_of.astype(np.uint16),
            content_type=self._encoder.content_type,
            schema_version=self._encoder.schema_version,
        )


class FullError(Exception):
    """There is no room for a parcel."""


class Backlog(Protocol):
    """Parcels in order, numbered as they come; called from one thread at a time."""

    @property
    def waiting(self) -> int:
        """How many events are in it."""

    @property
    def outlives_the_process(self) -> bool:
        """Whether what is left in it at closing is still there for the next run."""

    def put(self, parcel: Batch) -> None:
        """Take in a parcel; raise `FullError` where there is no room for it."""

    def after(self, number: int) -> tuple[int, Batch] | None:
        """Return the first parcel with a number above that, or None."""

    def acknowledge(self, numbers: Iterable[int]) -> None:
        """Forget the parcels of those numbers."""

    def drop_oldest(self, after: int) -> int:
        """Forget the first parcel with a number above that and return how many events it had; 0 where there is none."""

    def close(self) -> None:
        """Let go of the file, where there is one."""


class MemoryBacklog:
    """Parcels in memory, at most so many bytes of messages; the first parcel always has room."""

    outlives_the_process = False

    def __init__(self, max_bytes: int) -> None:
        self._parcels: OrderedDict[int, Batch] = OrderedDict()
        self._last = 0
        self._bytes = 0
        self._max_bytes = max_bytes
        self.waiting = 0

    def put(self, parcel: Batch) -> None:
        """Take in a parcel; raise `FullError` where there is no room for it."""
        if self._parcels and self._bytes + len(parcel.body) > self._max_bytes:
            raise FullError
        self._last += 1
        self._parcels[self._last] = parcel
        self._bytes += len(parcel.body)
        self.waiting += len(parcel)

    def after(self, number: int) -> tuple[int, Batch] | None:
        """Return the first parcel with a number above that, or None."""
        if number + 1 in self._parcels:
            return number + 1, self._parcels[number + 1]
        return next(((each, parcel) for each, parcel in self._parcels.items() if each > number), None)

    def acknowledge(self, numbers: Iterable[int]) -> None:
        """Forget the parcels of those numbers."""
        for number in numbers:
            parcel = self._parcels.pop(number)
            self._bytes -= len(parcel.body)
            self.waiting -= len(parcel)

    def drop_oldest(self, after: int) -> int:
        """Forget the first parcel with a number above that and return how many events it had; 0 where there is none."""
        found = self.after(after)
        if found is None:
            return 0
        self.acknowledge([found[0]])
        return len(found[1])

    def close(self) -> None:
        """Forget everything."""
        self._parcels.clear()
