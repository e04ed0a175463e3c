"""The pump: every sink closed once, failures kept apart, events counted."""

from collections.abc import Iterator
from typing import Any

import pytest
from hypothesis import given, strategies as st
from opir_testing import stub_window

from opir_core.errors import ModelError, SinkError
from opir_core.output import SinkReport
from opir_core.output.pump import PumpReport, SinkGroup, pump
from opir_core.plugin import Delivery, Sink, Window


class Recorder(Sink):
    """A sink that counts, and fails on request."""

    def __init__(
        self, *, fails_at: int | None = None, fails_to_close: BaseException | None = None
    ) -> None:
        self.windows: list[Window] = []
        self.closed = 0
        self.delivered = 0
        self._fails_at = fails_at
        self._fails_to_close = fails_to_close

    def write(self, window: Window) -> None:
        assert not self.closed, "written after it was closed"
        self.windows.append(window)
        if len(self.windows) == self._fails_at:
            raise SinkError(f"full after {self.delivered}")
        self.delivered += len(window.detections)

    def close(self) -> Delivery:
        self.closed += 1
        if self._fails_to_close is not None:
            raise self._fails_to_close
        return Delivery(delivered=self.delivered)


def stream(*counts: int) -> Iterator[Window]:
    for count in counts:
        yield stub_window(count)


def write_all(outlets: SinkGroup, windows: Iterator[Window]) -> None:
    with outlets:
        for window in windows:
            outlets.write(window)


def failing_stream(error: BaseException) -> Iterator[Window]:
    yield stub_window(2)
    raise error


def test_every_sink_gets_every_window_in_order() -> None:
    windows = list(stream(2, 0, 3))
    first_sink = Recorder()
    second = Recorder()
    report = pump(windows, {"a": first_sink, "b": second})
    assert first_sink.windows == second.windows == windows
    assert report == PumpReport(3, 5, (SinkReport("a", 5, 0, 0), SinkReport("b", 5, 0, 0)))
    assert report.failures == ()
    assert (first_sink.closed, second.closed) == (1, 1)


def test_a_sink_that_fails_is_closed_and_the_others_go_on() -> None:
    failing_sink = Recorder(fails_at=2)
    healthy_sink = Recorder()
    report = pump(stream(2, 3, 4), {"bad": failing_sink, "good": healthy_sink})
    assert report.sinks == (SinkReport("bad", 2, 0, 7, "full after 2"), SinkReport("good", 9, 0, 0))
    assert report.failures == report.sinks[:1]
    assert (failing_sink.closed, healthy_sink.closed) == (1, 1)
    assert len(failing_sink.windows) == 2


def test_without_sinks_all_windows_are_drawn() -> None:
    assert pump(stream(1, 2), {}) == PumpReport(2, 3, ())


def test_when_every_sink_has_failed_no_more_windows_are_drawn() -> None:
    drawn = []
    ended = []

    def endless() -> Iterator[Window]:
        try:
            while True:
                drawn.append(1)
                yield stub_window(1)
        finally:
            ended.append(1)

    report = pump(endless(), {"a": Recorder(fails_at=1), "b": Recorder(fails_at=3)})
    assert (len(drawn), len(ended)) == (3, 1)
    assert report.sinks == (
        SinkReport("a", 0, 0, 3, "full after 0"),
        SinkReport("b", 2, 0, 1, "full after 2"),
    )


@pytest.mark.parametrize(
    "error", [KeyboardInterrupt(), ModelError("broken"), ZeroDivisionError(), SystemExit(1)]
)
def test_an_error_of_the_windows_closes_every_sink_once(error: BaseException) -> None:
    failed = Recorder(fails_at=1)
    healthy_sink = Recorder()
    with pytest.raises(type(error)):
        pump(failing_stream(error), {"failed": failed, "good": healthy_sink})
    assert (failed.closed, healthy_sink.closed) == (1, 1)


def test_an_error_of_a_callback_closes_the_sinks() -> None:
    healthy_sink = Recorder()

    def interrupt(_window: Window) -> None:
        raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        pump(stream(1), {"good": healthy_sink}, on_window=interrupt)
    assert healthy_sink.closed == 1


def test_a_defect_in_a_sink_is_passed_on_with_every_sink_closed() -> None:
    class Broken(Recorder):
        def write(self, window: Window) -> None:
            raise TypeError("a defect")

    broken = Broken()
    healthy_sink = Recorder()
    with pytest.raises(TypeError, match="a defect"):
        pump(stream(1), {"broken": broken, "good": healthy_sink})
    assert (broken.closed, healthy_sink.closed) == (1, 1)


def test_progress_is_reported_once_a_window_is_taken() -> None:
    sink = Recorder()
    reported: list[tuple[int, int]] = []
    pump(
        stream(2, 3),
        {"a": sink},
        on_window=lambda window: reported.append((len(window.detections), sink.delivered)),
    )
    assert reported == [(2, 2), (3, 5)]


def test_a_sink_that_fails_to_close_is_reported() -> None:
    failing_sink = Recorder(fails_to_close=SinkError("no answer"))
    healthy_sink = Recorder()
    report = pump(stream(2), {"bad": failing_sink, "good": healthy_sink})
    assert report.sinks == (SinkReport("bad", 0, 0, 2, "no answer"), SinkReport("good", 2, 0, 0))


def test_a_sink_that_fails_twice_reports_the_first_error() -> None:
    failing_sink = Recorder(fails_at=1, fails_to_close=SinkError("no answer"))
    assert pump(stream(2), {"bad": failing_sink}).sinks == (
        SinkReport("bad", 0, 0, 2, "full after 0"),
    )
    assert failing_sink.closed == 1


@pytest.mark.parametrize("error", [KeyboardInterrupt(), RuntimeError("a defect")])
def test_an_error_in_closing_one_does_not_keep_the_others_open(error: BaseException) -> None:
    first_sink = Recorder()
    failing_sink = Recorder(fails_to_close=error)
    last_sink = Recorder()
    outlets = SinkGroup({"first": first_sink, "bad": failing_sink, "last": last_sink})
    with pytest.raises(type(error)), outlets:
        outlets.write(stub_window(1))
    assert (first_sink.closed, failing_sink.closed, last_sink.closed) == (1, 1, 1)
    outlets.close()
    assert (first_sink.closed, failing_sink.closed, last_sink.closed) == (1, 1, 1)
    assert [sink.error for sink in outlets.report().sinks] == [
        None,
        "closing it was interrupted",
        None,
    ]


def test_the_report_can_be_had_after_an_interruption() -> None:
    outlets = SinkGroup({"a": Recorder()})
    with pytest.raises(KeyboardInterrupt):
        write_all(outlets, failing_stream(KeyboardInterrupt()))
    assert outlets.report() == PumpReport(1, 2, (SinkReport("a", 2, 0, 0),))


def test_what_a_sink_spooled_is_neither_delivered_nor_dropped() -> None:
    class Spooling(Recorder):
        def close(self) -> Delivery:
            super().close()
            return Delivery(delivered=1, spooled=3)

    assert pump(stream(4), {"a": Spooling()}).sinks == (SinkReport("a", 1, 3, 0),)
    failed = Spooling(fails_at=2)
    assert pump(stream(4, 2), {"a": failed}).sinks == (SinkReport("a", 1, 3, 2, "full after 4"),)


@given(st.lists(st.integers(0, 3), max_size=6), st.lists(st.none() | st.integers(1, 7), max_size=4))
def test_events_in_are_events_out_whatever_fails(
    counts: list[int], fails_at: list[int | None]
) -> None:
    sinks: dict[str, Any] = {
        str(number): Recorder(fails_at=at) for number, at in enumerate(fails_at)
    }
    report = pump(stream(*counts), sinks)
    for sink in report.sinks:
        assert sink.delivered + sink.spooled + sink.dropped == report.events
        assert sink.delivered == sinks[sink.name].delivered
    assert [sink.closed for sink in sinks.values()] == [1] * len(sinks)
