"""Changes that other threads ask of a run: a turn for each, a queue to the run's own thread, and its answers.

Turns: who changes a run waits for the run to take it, and not for ever.
"""

import queue
import threading
import time
from collections.abc import Callable, Iterator
from concurrent.futures import Future, wait

from opir_core.errors import OpirError
from opir_core.live.change_validation import Draft

#: How long a change may wait, in all, for its turn and for the run to take it.
_CHANGE_S = 8.0
_POLL_S = 0.1
_LOOK_S = 0.005


class RefusedError(OpirError):
    """A change that the run cannot take: it has ended, too many wait, or the moment is past."""


class BusyError(RefusedError):
    """A change that may be taken later."""


class PastError(RefusedError):
    """A launch that is not before it can be taken in."""


class Turn:
    """The turn of one who changes the run: a context that gives the moment, of the steady clock, to give up at.

    Raises `BusyError` where too many wait for theirs, or it does not come.
    """

    def __init__(self, waiting: threading.BoundedSemaphore, changing: threading.Lock) -> None:
        self._waiting, self._changing = waiting, changing

    def __enter__(self) -> float:
        if not self._waiting.acquire(blocking=False):
            raise BusyError("too many changes wait for their turn; try again")
        give_up_s = time.monotonic() + _CHANGE_S
        if not self._changing.acquire(timeout=_CHANGE_S):
            self._waiting.release()
            raise BusyError("other changes take their time; try again")
        return give_up_s

    def __exit__(self, _kind: object, _error: object, _trace: object) -> None:
        self._changing.release()
        self._waiting.release()


def answered(answer: "Future[int]", stopping: threading.Event, give_up_s: float) -> int:
    """Return the answer to a change; one that the run has not taken up by then is withdrawn.

    Raises `BusyError` where the run takes up nothing until `give_up_s`, `RefusedError` where it is being stopped.
    """
    while not wait([answer], _POLL_S).done:
        if stopping.is_set() and answer.cancel():
            raise RefusedError("the run is being stopped")
        if time.monotonic() >= give_up_s and answer.cancel():
            raise BusyError("the run is held up by a sink that takes no more; try again")
    return answer.result()


def waited_for(is_so: Callable[[], bool], stopping: threading.Event, give_up_s: float) -> bool:
    """Return whether something came to be so; waits for it until `give_up_s`, or until the run is stopped."""
    while not is_so():
        if stopping.wait(_LOOK_S) or time.monotonic() >= give_up_s:
            return False
    return True


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
