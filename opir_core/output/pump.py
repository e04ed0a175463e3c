"""The pump: writes windows into the sinks of a batch run, one after the other.

A sink that fails is closed and left out; the other sinks continue. Every sink is closed exactly
once.
"""

from collections.abc import Callable, Generator, Iterable, Mapping
from contextlib import ExitStack
from types import TracebackType
from typing import Self

from attrs import frozen

from opir_core.interfaces.outputs import Sink
from opir_core.interfaces.records import Window
from opir_core.output.events.encoder_input import detection_count
from opir_core.output.sink_thread import COUNTS, Counter, OpenSink


@frozen
class SinkReport:
    """Event counts of a sink (see `Delivery`); `error` is the reason of its failure, or None."""

    name: str
    delivered: int
    spooled: int
    dropped: int
    error: str | None = None
    withheld: int = 0
    recovered: int = 0


@frozen
class PumpReport:
    """Number of windows and detections, and the report of each sink, in the order of the sinks."""

    windows: int
    events: int
    sinks: tuple[SinkReport, ...]

    @property
    def failures(self) -> tuple[SinkReport, ...]:
        """Return the reports of the sinks that failed."""
        return tuple(sink for sink in self.sinks if sink.error is not None)


class SinkGroup:
    """The sinks of a batch run: a context that closes them; its report is available afterwards too.

    `counts` are the functions that count a window's events, by the names of sinks whose events are
    not detections. Exceptions of a sink other than `SinkError` are defects and are passed on.
    """

    def __init__(
        self, sinks: Mapping[str, Sink], counts: Mapping[str, Counter] | None = None
    ) -> None:
        counters = counts or {}
        self._sinks = tuple(
            OpenSink(name, sink, counters.get(name, detection_count))
            for name, sink in sinks.items()
        )
        self.windows = 0
        self.events = 0

    def __enter__(self) -> Self:
        """Return the group."""
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        """Close every open sink."""
        self.close()

    @property
    def have_all_failed(self) -> bool:
        """Whether there are sinks and all of them are closed."""
        return bool(self._sinks) and all(sink.is_closed for sink in self._sinks)

    def write(self, window: Window) -> None:
        """Write a window to every open sink."""
        self.windows += 1
        self.events += len(window.detections)
        for sink in self._sinks:
            sink.write_now(window)

    def close(self) -> None:
        """Close every open sink; an exception of one does not keep the others open."""
        with ExitStack() as closings:
            for sink in reversed(self._sinks):
                closings.callback(sink.close_now)

    def report(self) -> PumpReport:
        """Return the reports of the closed sinks."""
        closed = [(sink, sink.delivery()) for sink in self._sinks if sink.is_closed]
        reports = (
            SinkReport(
                name=sink.path,
                error=sink.error,
                **{count: getattr(counts, count) for count in COUNTS},
            )
            for sink, counts in closed
        )
        return PumpReport(self.windows, self.events, tuple(reports))


def pump(
    windows: Iterable[Window],
    sinks: Mapping[str, Sink],
    *,
    on_window: Callable[[Window], None] | None = None,
    counts: Mapping[str, Counter] | None = None,
) -> PumpReport:
    """Write windows into sinks, by name, and return the report; `on_window` is called after each
    window is written.

    Ends early when every sink has failed. A generator of windows is closed at the end. Exceptions
    of the windows or of `on_window` are passed on, with the sinks closed; use `SinkGroup` to get
    the report in this case. `counts` is as in `SinkGroup`.
    """
    with SinkGroup(sinks, counts) as group, ExitStack() as ending:
        if isinstance(windows, Generator):
            ending.callback(windows.close)
        for window in windows:
            group.write(window)
            if on_window is not None:
                on_window(window)
            if group.have_all_failed:
                break
    return group.report()
