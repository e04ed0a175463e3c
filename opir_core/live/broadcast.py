"""Windows to viewers: whoever is slow loses the oldest, and is told how many; nobody waits for anybody."""

import threading
from collections import deque
from typing import Generic, TypeVar

Item = TypeVar("Item")


class Viewer(Generic[Item]):
    """A bounded queue whose oldest items give way; `dropped` counts them."""

    def __init__(self, size: int) -> None:
        self._items: deque[Item] = deque()
        self._size = size
        self._ready = threading.Condition()
        self._is_closed = False
        self.dropped = 0

    def put(self, item: Item) -> None:
        """Take an item; never waits."""
        with self._ready:
            if len(self._items) >= self._size:
                self._items.popleft()
                self.dropped += 1
            self._items.append(item)
            self._ready.notify()

    def take(self, timeout_s: float) -> Item | None:
        """Return the oldest item, waiting for one up to `timeout_s`; None where none comes or the queue is closed."""
        with self._ready:
            self._ready.wait_for(lambda: self._items or self._is_closed, timeout_s)
            return self._items.popleft() if self._items else None

    @property
    def is_over(self) -> bool:
        """Whether nothing is left and nothing more will come."""
        with self._ready:
            return self._is_closed and not self._items

    def close(self) -> None:
        """Say that nothing more will come."""
        with self._ready:
            self._is_closed = True
            self._ready.notify_all()
