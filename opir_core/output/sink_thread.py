"""Open sinks with their event counts: `OpenSink` writes at once, `SinkThread` from a queue, in a
thread of its own.

In both, given + recovered = delivered + spooled + dropped + withheld + events in queued windows.
"""

import math
import queue
import threading
import time
from collections.abc import Callable
from contextlib import suppress
from typing import Any

from attrs import evolve, frozen

from opir_core.errors import SinkError
from opir_core.host.error_messages import described_error
from opir_core.interfaces.outputs import Delivery, Sink
from opir_core.interfaces.records import Window
from opir_core.output.events.encoder_input import detection_count

#: Maximum number of windows in the queue of a sink of a live run without a spool.
QUEUED_WINDOWS = 200
#: Maximum bytes of messages that wait in memory for a destination, for an output without a spool.
MEMORY_BYTES = 64 << 20
#: What is true of an output without a spool.
WITHOUT_SPOOL = (
    f"no spool: what waits for its destination is in memory (at most {MEMORY_BYTES >> 20} MiB of"
    f" messages, and"
    f" {QUEUED_WINDOWS} windows of a live run) and is lost with the process; if the destination"
    f" refuses events for good"
    " the output ends, and drops and counts the rest; spool: {path: FILE} keeps them"
)

#: The counts of a `Delivery`.
COUNTS = ("delivered", "spooled", "dropped", "withheld", "recovered")
#: The fates of events, those a sink is least believed in first.
_FATES = ("delivered", "dropped", "withheld", "spooled")

_POLL_S = 0.05
#: Time, s, in which a sink with a spool must close when it is replaced; the new sink sends the rest
#: of the spool.
_REPLACEMENT_S = 2.5


@frozen
class SinkStatus:
    """Event counts of a sink (see `Delivery`) and its queue; `given` are the events of all windows
    written to it.

    `error` is why the sink has failed or is parked, or, of an open one, why nothing gets through at
    the moment; `attempts` is the number of failed attempts since the last success. `busy_s` is the
    duration, s, of the sink's present call in its own thread, 0 if there is none. `unbalanced` is
    the largest number of events by which the sink's own figures did not add up; the counts here do.
    `has_spool` is whether a file keeps what waits for the destination; otherwise it is lost with
    the process.
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
    busy_s: float
    attempts: int
    unbalanced: int
    has_spool: bool
    error: str | None


#: Returns the number of a window's events for a sink.
Counter = Callable[[Window], int]


@frozen
class _Replacement:
    make: Callable[[], Sink]
    count: Counter


class OpenSink:
    """A sink, its event counts and its first error; it is closed once.

    `count` returns the number of a window's events for the sink. `write_now` and `close_now` call
    the sink in the caller's thread and pass on exceptions other than `SinkError`.
    """

    def __init__(self, path: str, sink: Sink, count: Counter = detection_count) -> None:
        self.path = path
        #: The number of events of a window: for the windows given from now on, and for those
        #: written now.
        self._count = count
        self._count_written = self._count
        self.error: str | None = None
        self._sink = sink
        self._given = 0
        self._handed = 0
        self._written = 0
        #: By how many events the sink's own figures did not add up, at most.
        self.unbalanced = 0
        self._replaced = Delivery(delivered=0)
        self._final: Delivery | None = None

    @property
    def is_closed(self) -> bool:
        """Whether the sink is closed."""
        return self._final is not None

    def takes(self, window: Window) -> bool:
        """Return whether the sink takes a window: one with events for it, or each."""
        return self._count(window) > 0 or self._sink.takes_quiet_windows

    def write_now(self, window: Window) -> None:
        """Write a window; a closed sink only counts it, and a sink that fails is closed."""
        self._given += self._count(window)
        if self.is_closed:
            return
        try:
            self._pass(window)
        except SinkError as error:
            self._fail(str(error))
            self.close_now()

    def close_now(self) -> None:
        """Close the sink if it is open."""
        try:
            self._end()
        except BaseException:
            self._fail("closing it was interrupted")
            raise

    def delivery(self) -> Delivery:
        """Return the counts so far; events that a failed sink has not accounted for are dropped."""
        counts = _sum(self._replaced, self._current())
        if self.error is None:
            return counts
        lost = self._given + counts.recovered - counts.delivered - counts.spooled - counts.withheld
        return evolve(counts, dropped=max(counts.dropped, lost))

    def _current(self) -> Delivery:
        """Return the counts of the present sink: its own, or all that was written as delivered."""
        if self._final is not None:
            return self._final
        delivery = self._sink.delivery_so_far()
        if delivery is not None:
            return self._checked(delivery, is_final=False)
        # Taken is not delivered: what becomes of it a sink reports when it is closed, and this one
        # fails to.
        return Delivery(delivered=0 if self.error else self._written)

    def _checked(self, delivery: Delivery, *, is_final: bool) -> Delivery:
        """Return a sink's counts, made to add up; says so if they did not."""
        counts, off = balanced(
            delivery,
            self._handed,
            is_final=is_final and self.error is None and delivery.complaint is None,
        )
        if off:
            self.unbalanced = max(self.unbalanced, off)
            if is_final:
                self._fail(
                    f"the figures of its sink do not add up, by {off} events; see the sink's"
                    f" `close`"
                )
        return counts

    def _pass(self, window: Window) -> None:
        self._handed += self._count_written(window)
        self._sink.write(window)
        self._written += self._count_written(window)

    def _end(self) -> None:
        """Close the sink, unless it is closed, and keep its final counts; a defect of it is
        raised.
        """
        if self.is_closed:
            return
        final = Delivery(delivered=0)
        try:
            final = self._checked(self._sink.close(), is_final=True)
        except SinkError as error:
            self._fail(str(error))
        finally:
            self._final = final
        if final.complaint is not None:
            self._fail(final.complaint)

    def _fail(self, reason: str) -> None:
        self.error = self.error or reason


class SinkThread(OpenSink):
    """A sink of a live run, with its thread: a slow sink does not delay the others, and none loses
    events.

    A sink with a spool (`is_spooled`) is written before `write` returns; its spool sends the events
    later. Any other has a queue of at most `QUEUED_WINDOWS` windows, lost with the process; when it
    is full, `write` waits, which `SinkStatus.waits` counts. States: open, parked, failed, closed.
    Exceptions of the sink are its `error`, not raised.
    """

    def __init__(
        self,
        path: str,
        name: str,
        sink: Sink,
        *,
        is_spooled: bool = False,
        count: Counter = detection_count,
    ) -> None:
        super().__init__(path, sink, count)
        self.name = name
        self.is_spooled = is_spooled
        self._replacement_done = threading.Condition()
        self._replacements = 0
        self._queue: queue.Queue[Window | _Replacement | None] = queue.Queue(QUEUED_WINDOWS)
        self._waits = 0
        self._deadline_s = math.inf
        #: Time of the monotonic clock at which the present call of the sink began.
        self._busy_since_s: float | None = None
        self._thread = threading.Thread(target=self._work, name=f"opir-{path}", daemon=True)
        self._thread.start()

    @property
    def busy_s(self) -> float:
        """Duration, s, of the sink's present call in its thread; 0 if there is none."""
        since_s = self._busy_since_s
        return 0.0 if since_s is None else max(0.0, time.monotonic() - since_s)

    @property
    def thread(self) -> int | None:
        """The identifier of the sink's thread."""
        return self._thread.ident

    def write(self, window: Window, stopping: threading.Event) -> None:
        """Spool or queue a window; waits for room until there is some, the sink has failed or the
        run is stopped.
        """
        if self.is_spooled:
            # Written in the caller's thread; if this fails, the sink's own thread closes it.
            with self._replacement_done:
                while self._replacements and self.error is None and not stopping.is_set():
                    self._replacement_done.wait(_POLL_S)
            if self._replacements:
                self._fail("the run was stopped before it was opened anew")
            if self.error is None and not self._try(lambda: self._pass(window)):
                self._queue.put(None)
            self._given += self._count(window)
        else:
            self._given += self._count(window)
            self._queue_up(window, stopping)

    def replace(
        self,
        make: Callable[[], Sink],
        stopping: threading.Event,
        *,
        is_spooled: bool = False,
        count: Counter = detection_count,
    ) -> None:
        """Close the sink after its queued windows, and continue with the one that `make` returns;
        waits as `write` does.
        """
        with self._replacement_done:
            self._replacements += 1
        self.is_spooled = is_spooled
        self._count = count
        self._queue_up(_Replacement(make, count), stopping)

    def close_by(self, deadline_s: float) -> None:
        """Set the time of the monotonic clock by which the sink must be closed."""
        self._deadline_s = deadline_s
        self._sink.close_by(deadline_s)

    def close(self, deadline_s: float) -> None:
        """Close the sink after its queued windows; stop waiting at `deadline_s` of the monotonic
        clock.
        """
        self.close_by(deadline_s)
        try:
            self._queue.put(None, timeout=max(0.0, deadline_s - time.monotonic()))
        except queue.Full:
            self._fail("it did not take its events before the deadline")
        self._thread.join(max(0.0, deadline_s - time.monotonic()))
        if self._thread.is_alive():
            self._fail("it did not close before the deadline")

    @property
    def parked(self) -> str | None:
        """Why the destination refuses the events that the sink keeps for it, or None."""
        return self._sink.parked

    @property
    def has_waiting_in_memory(self) -> bool:
        """Whether the sink sends later what it has been given, and keeps it in memory meanwhile."""
        return self._sink.outlives_the_process is False

    def retry(self) -> bool:
        """Let a parked sink try again at once; return whether it was parked."""
        return self._sink.retry()

    def status(self) -> SinkStatus:
        """Return the event counts and the state."""
        counts = self.delivery()
        return SinkStatus(
            path=self.path,
            name=self.name,
            state="failed"
            if self.error
            else "closed"
            if self.is_closed
            else "parked"
            if self.parked
            else "open",
            given=self._given,
            **{count: getattr(counts, count) for count in COUNTS},
            queued_windows=self._queue.qsize(),
            waits=self._waits + self._sink.waits,
            busy_s=self.busy_s,
            attempts=0 if self.is_closed else self._sink.attempts,
            unbalanced=self.unbalanced,
            has_spool=self.is_spooled,
            error=self.error or (None if self.is_closed else self.parked or self._sink.trouble),
        )

    def _queue_up(self, item: Window | _Replacement, stopping: threading.Event) -> None:
        waited = False
        while self.error is None:
            with suppress(queue.Full):
                self._queue.put(item, timeout=_POLL_S)
                return
            self._waits += not waited
            waited = True
            if stopping.is_set():
                return

    def _work(self) -> None:
        self._try(self._empty_queue)
        self._busy_since_s = time.monotonic()
        self._try(self._end)
        self._busy_since_s = None
        self._count_replacements(self._replacements)

    def _empty_queue(self) -> None:
        while (item := self._queue.get()) is not None:
            self._busy_since_s = time.monotonic()
            if isinstance(item, Window):
                self._pass(item)
            else:
                self._change(item)
            self._busy_since_s = None

    def _try(self, work: Callable[[], None]) -> bool:
        """Return whether a call raised nothing; a defect of one sink must not end the run."""
        try:
            work()
        except SinkError as error:
            self._fail(str(error))
        except BaseException as error:  # also SystemExit: a sink must not end its thread unnoticed
            self._fail(f"{self.name}: {described_error(error)}")
        else:
            return True
        return False

    def _change(self, replacement: "_Replacement") -> None:
        if self._sink.outlives_the_process:
            self._sink.close_by(min(self._deadline_s, time.monotonic() + _REPLACEMENT_S))
        closed = Delivery(delivered=0)
        try:
            closed = self._checked(self._sink.close(), is_final=True)
            sink = replacement.make()
        except BaseException:
            self._final = closed
            raise
        total = _sum(self._replaced, closed)
        self._written = 0
        self._handed = 0
        self._sink = sink
        self._count_written = replacement.count
        # Events left in a spool that both sinks share are counted once: with the new sink.
        recovered_twice = min(total.spooled, self._current().recovered)
        self._replaced = evolve(
            total,
            spooled=total.spooled - recovered_twice,
            recovered=total.recovered - recovered_twice,
        )
        if self._deadline_s < math.inf:
            self._sink.close_by(self._deadline_s)
        self._count_replacements(1)

    def _count_replacements(self, done: int) -> None:
        with self._replacement_done:
            self._replacements -= done
            self._replacement_done.notify_all()


def _sum(delivery: Delivery, addition: Delivery) -> Delivery:
    return Delivery(**{name: getattr(delivery, name) + getattr(addition, name) for name in COUNTS})


def balanced(delivery: Delivery, handed: int, *, is_final: bool) -> tuple[Delivery, int]:
    """Return a sink's counts, made to add up, and by how many events they did not.

    `handed` events were handed to the sink. What it reports beyond these and the recovered ones is
    taken away; a count other than a whole number from 0 up is 0. Of events that are missing at the
    end, when `is_final`, it is not known what became of them: they are dropped.
    """
    counts: dict[str, Any] = {name: _whole(getattr(delivery, name)) for name in COUNTS}
    wrong = sum(counts[name] != getattr(delivery, name) for name in COUNTS)
    expected = handed + counts["recovered"]
    beyond = sum(counts[name] for name in _FATES) - expected
    if beyond > 0:
        surplus = beyond
        for name in _FATES:
            taken = min(surplus, counts[name])
            counts[name] = counts[name] - taken
            surplus = surplus - taken
    elif is_final:
        counts["dropped"] -= beyond
    else:
        beyond = 0
    return (
        (evolve(delivery, **counts), max(abs(beyond), wrong)) if beyond or wrong else (delivery, 0)
    )


def _whole(count: object) -> int:
    return count if type(count) is int and count > 0 else 0
