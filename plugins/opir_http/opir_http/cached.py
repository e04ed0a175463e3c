"""Cached documents: made off the event loop, at a limited rate, once for all concurrent requests."""

import asyncio
import time
from collections.abc import Callable
from typing import Generic, TypeVar

Made = TypeVar("Made")


class Cached(Generic[Made]):
    """The result of `make`, called in a thread when the last one is older than `for_s`; for one event loop."""

    def __init__(self, make: Callable[[], Made], for_s: float) -> None:
        self._make = make
        self._for_s = for_s
        self._made: tuple[float, Made] | None = None
        self._making: asyncio.Task[Made] | None = None

    async def get(self) -> Made:
        """Return the result; waits for a new one if it is too old."""
        if self._made is not None and time.monotonic() - self._made[0] < self._for_s:
            return self._made[1]
        if self._making is None:
            self._making = asyncio.create_task(asyncio.to_thread(self._make))
            self._making.add_done_callback(self._keep)
        return await asyncio.shield(self._making)

    def forget(self) -> None:
        """Make a new result for the next request; the one in progress is for earlier requests."""
        self._made = self._making = None

    def _keep(self, making: "asyncio.Task[Made]") -> None:
        if making is self._making:
            self._making = None
            if not making.cancelled() and making.exception() is None:
                self._made = time.monotonic(), making.result()
