"""Changes that other threads ask of a run: a turn for each, a queue to the run's own thread, and its answers."""

import queue
import threading
from collections.abc import Iterator
from concurrent.futures import Future

from opir_core.live.drafting import Draft
from opir_core.live.turns import Turn, answered

_WAITING_CHANGES = 16


class Changes:
    """What is asked of a run and not yet answered."""

    def __init__(self, stopping: threading.Event) -> None:
        self._stopping = stopping
        self._drafts: queue.Queue[tuple[Draft, Future[int]]] = queue.Queue(_WAITING_CHANGES)
        self._changing = threading.Lock()
        self._waiting = threading.BoundedSemaphore(_WAITING_CHANGES)

    def turn(self) -> Turn:
        """Return the turn of one who changes the run."""
        return Turn(self._waiting, self._changing)

    def taken(self, draft: Draft, give_up_s: float) -> int:
        """Ask for a draft to take over and return the cycle at whose start it did; raises as `answered` does."""
        answer: Future[int] = Future()
        self._drafts.put_nowait((draft, answer))
        return answered(answer, self._stopping, give_up_s)

    def asked(self) -> "Iterator[tuple[Draft, Future[int]]]":
        """Yield what was asked for and not withdrawn; the run's thread owes each an answer."""
        while not self._drafts.empty():
            draft, answer = self._drafts.get_nowait()
            if answer.set_running_or_notify_cancel():
                yield draft, answer
