"""The sink `null`: it counts events and forgets them.

The sink that keeps what it is given.
"""

import json
from collections.abc import Callable
from typing import Any

from opir_core.interfaces.protocols import Delivery, Encoder
from opir_core.interfaces.records import Window


class MemorySink:
    """Keeps windows; encodes only when events are asked for."""

    def __init__(self, make_encoder: Callable[[], Encoder]) -> None:
        self._make_encoder = make_encoder
        #: What came, in order; still there after closing.
        self.windows: list[Window] = []

    def __len__(self) -> int:
        """Return the number of events kept."""
        return sum(len(window.detections) for window in self.windows)

    def write(self, window: Window) -> None:
        """Keep the window."""
        self.windows.append(window)

    def lines(self) -> bytes:
        """Return all events as the encoder writes them."""
        encoder = self._make_encoder()
        return b"".join(map(encoder.encode, self.windows))

    def events(self) -> list[dict[str, Any]]:
        """Return all events, read back from the encoder's JSON."""
        return [json.loads(line) for line in self.lines().splitlines()]

    def close(self) -> Delivery:
        """Return all as delivered."""
        return Delivery(delivered=len(self))


class Nowhere:
    """Takes events and forgets them."""

    def __init__(self) -> None:
        self._taken = 0

    def write(self, window: Window) -> None:
        """Count the window's events."""
        self._taken += len(window.detections)

    def close(self) -> Delivery:
        """Return all as delivered."""
        return Delivery(delivered=self._taken)
