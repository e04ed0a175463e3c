"""Sinks of a live run: a slow one does not hold up the others, and none loses events.

An output with a spool writes each window down before `write` returns; its own thread sends it on. Any other has a
bounded queue and a thread: what is in the queue is lost with the process, and one that is behind by more than the queue
holds makes the run wait, which is counted. An output that may be slow or away is given a spool.
"""

import math
import queue
import threading
import time
from collections.abc import Callable

from attrs import evolve, frozen

from opir_core.errors import SinkError
from opir_core.interfaces.optional import BufferingSink, DeadlineSink, MonitoredSink
from opir_core.interfaces.protocols import Delivery, Sink
from opir_core.interfaces.records import Window

#: Windows that may wait for a sink without a spool.
QUEUED_WINDOWS = 200

_POLL_S = 0.05
#: How long a sink with a spool has to let go when it is replaced, s; what it has not sent its successor sends.
_REPLACED_S = 2.5


@frozen
class SinkStatus:
    """What a sink has taken: events given to it, what it says became of them, and how much waits for it.

    given + recovered = delivered + spooled + dropped + withheld + those in queued windows.
    """

    path: str
    name: str
    state: str
    given: int
    delivered: int
    spooled: int
    dropped: int
    withheld: int
    recovered: int
    queued_windows: int
    waits: int
    error: str | None


class SinkThread:
    """One sink and its thread. States: open, failed, closed. `is_kept` says whether the sink has a spool."""

    def __init__(self, path: str, name: str, sink: Sink, *, is_kept: bool = False) -> None:
        self.path, self.name, self.is_kept = path, name, is_kept
        self._sink = sink
        self._at_hand = threading.Condition()
        self._changes = 0
        self._queue: queue.Queue[Window | Callable[[], Sink] | None] = queue.Queue(QUEUED_WINDOWS)
        self._thread = threading.Thread(target=self._work, name=f"opir-{path}", daemon=True)
        self._given = self._written = self._waits = 0
        self._ended = Delivery(delivered=0)
        self._final: Delivery | None = None
        self._error: str | None = None
        self._deadline_s = math.inf
        self._thread.start()

    def write(self, window: Window, stopping: threading.Event) -> None:
        """Have a window written down, or queued; waits for room until there is some or the sink has failed."""
        if self.is_kept:
            self._keep(window)
            self._given += len(window.detections)
        else:
            self._given += len(window.detections)
            self._queue_up(window, stopping)

    def replace(self, make: Callable[[], Sink], *, is_kept: bool = False) -> None:
        """Close the sink once it has what was queued, and go on with the one that `make` returns."""
        with self._at_hand:
            self._changes += 1
        self.is_kept = is_kept
        self._queue.put(make)

    def close_by(self, deadline_s: float) -> None:
        """Say that the sink is to be closed by `deadline_s` of the steady clock."""
        self._deadline_s = deadline_s
        self._tell(deadline_s)

    def close(self, deadline_s: float) -> None:
        """Close the sink once it has what was queued; give up waiting at `deadline_s` of the steady clock."""
        self.close_by(deadline_s)
        try:
            self._queue.put(None, timeout=max(0.0, deadline_s - time.monotonic()))
        except queue.Full:
            self._error = self._error or "it did not take its events before the deadline"
        self._thread.join(max(0.0, deadline_s - time.monotonic()))
        if self._thread.is_alive():
            self._error = self._error or "it did not close before the deadline"

    def status(self) -> SinkStatus:
        """Return what the sink has taken."""
        told, given = _sum(self._ended, self._standing()), self._given
        lost = given + told.recovered - told.delivered - told.spooled - told.withheld
        return SinkStatus(
            path=self.path,
            name=self.name,
            state="failed" if self._error else "closed" if self._final else "open",
            given=given,
            delivered=told.delivered,
            spooled=told.spooled,
            dropped=max(0, lost) if self._error else told.dropped,
            withheld=told.withheld,
            recovered=told.recovered,
            queued_windows=self._queue.qsize(),
            waits=self._waits + (self._sink.waits if isinstance(self._sink, BufferingSink) else 0),
            error=self._error,
        )

    def _standing(self) -> Delivery:
        """Return what became of the events of the sink at hand: its own word, or that it took what it was given."""
        if self._final is not None:
            return self._final
        sink = self._sink
        return sink.delivery_so_far() if isinstance(sink, MonitoredSink) else Delivery(delivered=self._written)

    def _keep(self, window: Window) -> None:
        """Let the sink write a window down, in the thread of who asks; where it fails, its own thread closes it."""
        with self._at_hand:
            self._at_hand.wait_for(lambda: not self._changes or self._error is not None)
        if self._error is not None:
            return
        try:
            self._sink.write(window)
        except SinkError as error:
            self._error = str(error)
        except Exception as error:  # a defect of one sink must not end the run
            self._error = f"{self.name}: {type(error).__name__}: {error}"
        else:
            self._written += len(window.detections)
            return
        self._queue.put(None)

    def _queue_up(self, window: Window, stopping: threading.Event) -> None:
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
        finally:
            self._has_changed(self._changes)

    def _change(self, make: Callable[[], Sink]) -> None:
        if isinstance(self._sink, BufferingSink) and self._sink.outlives_the_process:
            self._tell(min(self._deadline_s, time.monotonic() + _REPLACED_S))
        before = _sum(self._ended, self._sink.close())
        self._written = 0
        self._sink = make()
        # What the one before left in the spool that both have is no longer there, and was taken once.
        again = min(before.spooled, self._standing().recovered)
        self._ended = evolve(before, spooled=before.spooled - again, recovered=before.recovered - again)
        if self._deadline_s < math.inf:
            self._tell(self._deadline_s)
        self._has_changed(1)

    def _has_changed(self, changes: int) -> None:
        with self._at_hand:
            self._changes -= changes
            self._at_hand.notify_all()

    def _tell(self, deadline_s: float) -> None:
        """Tell a sink that can be told by when it is to be closed."""
        if isinstance(self._sink, DeadlineSink):
            self._sink.close_by(deadline_s)

    def _fail(self, error: str) -> None:
        self._error = self._error or error
        try:
            self._final = self._sink.close()
        except Exception as closing:  # what failed may fail again
            self._final = Delivery(delivered=0)
            self._error = f"{self._error}; closing it: {closing}"


def _sum(one: Delivery, other: Delivery) -> Delivery:
    return Delivery(
        delivered=one.delivered + other.delivered,
        spooled=one.spooled + other.spooled,
        dropped=one.dropped + other.dropped,
        withheld=one.withheld + other.withheld,
        recovered=one.recovered + other.recovered,
    )
