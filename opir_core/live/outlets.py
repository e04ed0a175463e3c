"""Sinks of a live run: each in a thread of its own, so that a slow one does not hold up the others.

A sink never loses events here. One that is behind by more than its queue holds makes the run wait, and that is counted;
an output that may be slow or away is given a spool.
"""

import math
import queue
import threading
import time
from collections.abc import Callable

from attrs import frozen

from opir_core.errors import SinkError
from opir_core.protocols import Delivery, Sink
from opir_core.records import Window

#: Windows that may wait for a sink.
QUEUED_WINDOWS = 200

_POLL_S = 0.05


@frozen
class OutletStatus:
    """What a sink has taken: events given to it, what it says became of them, and how much waits for it."""

    path: str
    name: str
    state: str
    given: int
    delivered: int
    spooled: int
    dropped: int
    queued_windows: int
    waits: int
    error: str | None


class Outlet:
    """One sink and its thread. States: open, failed, closed."""

    def __init__(self, path: str, name: str, sink: Sink) -> None:
        self.path, self.name = path, name
        self._sink = sink
        self._queue: queue.Queue[Window | Callable[[], Sink] | None] = queue.Queue(QUEUED_WINDOWS)
        self._thread = threading.Thread(target=self._work, name=f"opir-{path}", daemon=True)
        self._given = self._written = self._waits = 0
        self._ended = Delivery(delivered=0)
        self._final: Delivery | None = None
        self._error: str | None = None
        self._deadline_s = math.inf
        self._thread.start()

    def write(self, window: Window, stopping: threading.Event) -> None:
        """Queue a window; where the queue is full, wait until there is room or the sink has failed."""
        self._given += len(window.detections)
        waited = False
        while self._error is None:
            try:
                self._queue.put(window, timeout=_POLL_S)
            except queue.Full:
                self._waits += not waited
                waited = True
                if stopping.is_set():
                    return
            else:
                return

    def replace(self, make: Callable[[], Sink]) -> None:
        """Close the sink once it has what was queued, and go on with the one that `make` returns."""
        self._queue.put(make)

    def close(self, deadline_s: float) -> None:
        """Close the sink once it has what was queued; give up waiting at `deadline_s` of the steady clock."""
        self._deadline_s = deadline_s
        self._hurry()
        try:
            self._queue.put(None, timeout=max(0.0, deadline_s - time.monotonic()))
        except queue.Full:
            self._error = self._error or "it did not take its events before the deadline"
        self._thread.join(max(0.0, deadline_s - time.monotonic()))
        if self._thread.is_alive():
            self._error = self._error or "it did not close before the deadline"

    def status(self) -> OutletStatus:
        """Return what the sink has taken."""
        told = self._standing()
        state = "failed" if self._error else "closed" if self._final else "open"
        return OutletStatus(
            self.path,
            self.name,
            state,
            self._given,
            self._ended.delivered + told.delivered,
            self._ended.spooled + told.spooled,
            self._given - self._ended.delivered - told.delivered - told.spooled
            if self._error
            else self._ended.dropped + told.dropped,
            self._queue.qsize(),
            self._waits,
            self._error,
        )

    def _standing(self) -> Delivery:
        """Return what became of the events of the sink at hand: its own word, or that it took what it was given."""
        if self._final is not None:
            return self._final
        standing = getattr(self._sink, "standing", None)
        told = standing() if callable(standing) else None
        return told if isinstance(told, Delivery) else Delivery(delivered=self._written)

    def _work(self) -> None:
        try:
            while (item := self._queue.get()) is not None:
                if isinstance(item, Window):
                    self._sink.write(item)
                    self._written += len(item.detections)
                else:
                    self._change(item)
            self._final = self._sink.close()
        except SinkError as error:
            self._fail(str(error))
        except Exception as error:  # a defect of one sink must not end the run
            self._fail(f"{self.name}: {type(error).__name__}: {error}")

    def _change(self, make: Callable[[], Sink]) -> None:
        told = self._sink.close()
        ended = self._ended
        self._ended = Delivery(
            ended.delivered + told.delivered, ended.spooled + told.spooled, ended.dropped + told.dropped
        )
        self._written = 0
        self._sink = make()
        self._hurry()

    def _hurry(self) -> None:
        """Tell a sink that can be told by when it is to be closed, once that is known."""
        hurry = getattr(self._sink, "hurry", None)
        if callable(hurry) and self._deadline_s < math.inf:
            hurry(self._deadline_s)

    def _fail(self, error: str) -> None:
        self._error = error
        try:
            self._final = self._sink.close()
        except Exception as closing:  # what failed may fail again
            self._final = Delivery(delivered=0)
            self._error = f"{error}; closing it: {closing}"
