"""The sink `null`: it counts events and forgets them."""

from opir_core.protocols import Delivery
from opir_core.records import Window


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
