"""Documents that are made for many requests at once."""

import asyncio
import time
from collections.abc import Callable
from typing import Generic, TypeVar

#: Maximum age of cached documents, s.
_CACHED_S = 0.05
Result = TypeVar("Result")


class Cached(Generic[Result]):
    """The result of `make`, called in a thread when the last one is older than `for_s`; for one
    event loop.
    """

    def __init__(self, make: Callable[[], Result], for_s: float = _CACHED_S) -> None:
        self._make = make
        self._for_s = for_s
        self._cached: tuple[float, Result] | None = None
        self._task: asyncio.Task[Result] | None = None

    async def get(self) -> Result:
        """Return the result; waits for a new one if it is too old."""
        if self._cached is not None and time.monotonic() - self._cached[0] < self._for_s:
            return self._cached[1]
        if self._task is None:
            self._task = asyncio.create_task(asyncio.to_thread(self._make))
            self._task.add_done_callback(self._keep)
        return await asyncio.shield(self._task)

    def forget(self) -> None:
        """Make a new result for the next request; the one in progress is for earlier requests."""
        self._cached = None
        self._task = None

    def _keep(self, task: "asyncio.Task[Result]") -> None:
        if task is self._task:
            self._task = None
            if not task.cancelled() and task.exception() is None:
                self._cached = time.monotonic(), task.result()
