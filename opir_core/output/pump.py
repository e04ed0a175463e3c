"""The pump: windows into sinks, and what became of the events.

A sink that fails is closed and left out while the others go on; every sink is closed exactly once, whatever happens.
"""

from collections.abc import Callable, Generator, Iterable, Mapping
from contextlib import ExitStack
from types import TracebackType
from typing import Self

from attrs import frozen

from opir_core.errors import SinkError
from opir_core.interfaces.protocols import Delivery, Sink
from opir_core.interfaces.records import Window


@frozen
class SinkReport:
    """What became of the events that a sink was to take (see `Delivery`); `error` says why it failed, or is None."""

    name: str
    delivered: int
    spooled: int
    dropped: int
    error: str | None = None
    withheld: int = 0
    recovered: int = 0


@frozen
class PumpReport:
    """How much was pumped, and each sink's report in the order of the sinks."""

    windows: int
    events: int
    sinks: tuple[SinkReport, ...]

    @property
    def failures(self) -> tuple[SinkReport, ...]:
        """Return the reports of the sinks that failed."""
        return tuple(sink for sink in self.sinks if sink.error is not None)


class SinkGroup:
    """The sinks of a run: a context that closes them, and that can be asked for its report at any time after.

    What a sink raises other than `SinkError` is a defect, not a failure of the output, and is passed on.
    """

    def __init__(self, sinks: Mapping[str, Sink]) -> None:
        self._names = tuple(sinks)
        self._open = dict(sinks)
        self._closed: dict[str, tuple[Delivery | None, str | None]] = {}
        self.windows = 0
        self.events = 0

    def __enter__(self) -> Self:
        """Return the outlets."""
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        """Close every sink that is still open."""
        self.close()

    @property
    def have_all_failed(self) -> bool:
        """Whether there were sinks and none is left."""
        return bool(self._names) and not self._open

    def write(self, window: Window) -> None:
        """Give a window to every sink that is still open."""
        self.windows += 1
        self.events += len(window.detections)
        for name, sink in tuple(self._open.items()):
            try:
                sink.write(window)
            except SinkError as error:
                self._shut(name, str(error))

    def close(self) -> None:
        """Close every sink that is still open; an error of one does not keep the others from being closed."""
        with ExitStack() as closings:
            for name in reversed(tuple(self._open)):
                closings.callback(self._shut, name, None)

    def report(self) -> PumpReport:
        """Return what became of the events, of the sinks that are closed."""
        reports = (self._sink_report(name) for name in self._names if name in self._closed)
        return PumpReport(self.windows, self.events, tuple(reports))

    def _shut(self, name: str, failure: str | None) -> None:
        sink = self._open.pop(name)
        self._closed[name] = (None, failure or "closing it was interrupted")
        try:
            delivery = sink.close()
        except SinkError as error:
            self._closed[name] = (None, failure or str(error))
        else:
            self._closed[name] = (delivery, failure or delivery.complaint)

    def _sink_report(self, name: str) -> SinkReport:
        delivery, failure = self._closed[name]
        told = delivery or Delivery(delivered=0)
        missing = told.dropped
        if failure is not None:
            # A sink that failed has not seen all events, so it cannot know how many it has cost.
            accounted = told.delivered + told.spooled + told.withheld - told.recovered
            missing = max(told.dropped, self.events - accounted)
        return SinkReport(name, told.delivered, told.spooled, missing, failure, told.withheld, told.recovered)


def pump(
    windows: Iterable[Window], sinks: Mapping[str, Sink], *, on_window: Callable[[Window], None] | None = None
) -> PumpReport:
    """Drive windows into sinks, by name, and report; `on_window` is called when the sinks have taken one.

    Ends early when every sink has failed, for then nobody listens. A generator of windows is closed at the end. What
    the windows or `on_window` raise is passed on, the sinks closed; use `SinkGroup` to have their report then.
    """
    with SinkGroup(sinks) as outlets, ExitStack() as ending:
        if isinstance(windows, Generator):
            ending.callback(windows.close)
        for window in windows:
            outlets.write(window)
            if on_window is not None:
                on_window(window)
            if outlets.have_all_failed:
                break
    return outlets.report()
