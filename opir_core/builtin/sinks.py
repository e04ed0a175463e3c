"""The sinks `memory` and `null`, which write nothing."""

import json
from collections.abc import Callable
from typing import Any

from opir_core.builtin.configs import MemoryConfig
from opir_core.interfaces.contexts import SinkContext
from opir_core.interfaces.protocols import Delivery, Encoder
from opir_core.interfaces.records import Window
from opir_core.plugin.components import NoConfig


class MemorySink:
    """Keeps windows; encodes them on request."""

    def __init__(self, make_encoder: Callable[[], Encoder]) -> None:
        self._make_encoder = make_encoder
        #: The windows in order; available after closing.
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
        """Return all events as delivered."""
        return Delivery(delivered=len(self))


class NullSink:
    """Counts events and discards them."""

    def __init__(self) -> None:
        self._taken = 0

    def write(self, window: Window) -> None:
        """Count the window's events."""
        self._taken += len(window.detections)

    def close(self) -> Delivery:
        """Return all events as delivered."""
        return Delivery(delivered=self._taken)


def memory_sink(_config: MemoryConfig, context: SinkContext) -> MemorySink:
    """Return the sink `memory`."""
    return MemorySink(context.make_encoder)


def null_sink(_config: NoConfig, _context: SinkContext) -> NullSink:
    """Return the sink `null`."""
    return NullSink()
