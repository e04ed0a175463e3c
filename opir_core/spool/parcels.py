"""Parcels: encoded events on their way out, each with the key that its order is kept by."""

from collections.abc import Iterator, Sequence
from typing import Protocol

import numpy as np
from attrs import frozen
from numpy.typing import NDArray

from opir_core.events.blocks import only_encodable, window_blocks
from opir_core.protocols import Encoder, Sensor
from opir_core.records import Window

#: Events in a parcel: some 600 kB of the default encoder's, so that a few parcels make a broker's batch for each of
#: many partitions, and one is quickly read back from disk.
PARCEL_EVENTS = 1024


@frozen(eq=False, kw_only=True)
class Parcel:
    """Encoded events in the order of their times.

    `body` holds the messages, each ended by a newline; `keys` the sensors' ids, and `key_of` (n,) which of them is each
    event's. `content_type` and `schema_version` are the encoder's.
    """

    body: bytes
    keys: tuple[str, ...]
    key_of: NDArray[np.uint16]
    content_type: str
    schema_version: str

    def __len__(self) -> int:
        """Return the number of events."""
        return len(self.key_of)

    def messages(self) -> list[bytes]:
        """Return the messages, without their newlines."""
        return self.body.split(b"\n")[:-1]


class Packing(Protocol):
    """Makes parcels of windows."""

    def parcels(self, window: Window) -> Iterator[Parcel]:
        """Yield a window's events as parcels, in order."""


class Packer:
    """Makes parcels of an encoder's messages."""

    def __init__(self, encoder: Encoder, sensors: Sequence[Sensor]) -> None:
        self._encoder = encoder
        self._ids = np.array([sensor.id for sensor in sensors], dtype=object)

    def parcels(self, window: Window) -> Iterator[Parcel]:
        """Yield a window's events as parcels; those that the encoder has no message for are left out."""
        for block in window_blocks(window):
            kept = only_encodable(block, self._encoder)
            lines = self._encoder.encode(kept)
            if len(kept.detections):
                yield from self._cut(lines, kept.detections.sensor)

    def _cut(self, lines: bytes, sensor: NDArray[np.int32]) -> Iterator[Parcel]:
        """Yield parcels of at most `PARCEL_EVENTS` events of a block's lines."""
        whole = self._parcel(lines, sensor)
        if len(whole) <= PARCEL_EVENTS:
            yield whole
            return
        messages = whole.messages()
        for first in range(0, len(sensor), PARCEL_EVENTS):
            part = slice(first, first + PARCEL_EVENTS)
            yield self._parcel(b"\n".join([*messages[part], b""]), sensor[part])

    def _parcel(self, body: bytes, sensor: NDArray[np.int32]) -> Parcel:
        found, key_of = np.unique(sensor, return_inverse=True)
        return Parcel(
            body=body,
            keys=tuple(self._ids[found].tolist()),
            key_of=key_of.astype(np.uint16),
            content_type=self._encoder.content_type,
            schema_version=self._encoder.schema_version,
        )
