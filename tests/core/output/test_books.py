"""Books that balance: whatever figures a sink gives, every event is counted once, and a wrong
figure is reported.
"""

import threading
import time
from typing import Any

import pytest
from hypothesis import given, strategies as st
from opir_testing import stub_window
from waiting import until

from opir_core.errors import SinkError
from opir_core.output.pump import pump
from opir_core.output.sink_thread import SinkThread, balanced
from opir_core.plugin import Delivery, Sink, Window

FIGURES = st.integers(-20, 40)
COUNTS = dict.fromkeys(("delivered", "spooled", "dropped", "withheld", "recovered"), FIGURES)


def total(reported: Any) -> int:
    return int(reported.delivered + reported.spooled + reported.dropped + reported.withheld)


class Liar(Sink):
    """A sink that gives the figures that the test sets."""

    def __init__(self, reported: Any, *, fails_at: int = 0) -> None:
        self.reported = reported
        self.windows = 0
        self.fails_at = fails_at

    def write(self, window: Window) -> None:
        self.windows += 1
        if self.windows == self.fails_at:
            raise SinkError("full")

    def delivery_so_far(self) -> Any:
        return self.reported

    def close(self) -> Any:
        return self.reported


@given(st.builds(Delivery, **COUNTS), st.integers(0, 40), st.booleans())
def test_counts_add_up_whatever_is_reported(
    reported: Delivery, handed: int, is_final: bool
) -> None:
    counts, off = balanced(reported, handed, is_final=is_final)
    expected = handed + counts.recovered
    assert (
        min(counts.delivered, counts.spooled, counts.dropped, counts.withheld, counts.recovered)
        >= 0
    )
    assert total(counts) == expected if is_final else total(counts) <= expected
    assert counts.delivered <= max(0, reported.delivered)
    is_right = (
        total(reported) == handed + reported.recovered
        if is_final
        else total(reported) <= handed + reported.recovered
    )
    is_right = (
        is_right
        and min(
            reported.delivered,
            reported.spooled,
            reported.dropped,
            reported.withheld,
            reported.recovered,
        )
        >= 0
    )
    assert (off == 0) == is_right
    assert counts == reported if is_right else counts != reported


@pytest.mark.parametrize("figure", [float("nan"), None, 2.5, True, "5"])
def test_a_figure_that_is_no_number_of_events_counts_for_nothing(figure: Any) -> None:
    counts, off = balanced(Delivery(delivered=figure), 3, is_final=True)
    assert (counts.delivered, counts.dropped) == (0, 3)
    assert off > 0


@given(st.builds(Delivery, **COUNTS), st.lists(st.integers(0, 9), max_size=4), st.integers(0, 3))
def test_the_report_of_a_run_adds_up(reported: Delivery, windows: list[int], fails_at: int) -> None:
    report = pump(
        [stub_window(count) for count in windows], {"a": Liar(reported, fails_at=fails_at)}
    )
    (sink,) = report.sinks
    handed = sum(windows[:fails_at]) if 0 < fails_at <= len(windows) else sum(windows)
    assert total(sink) == handed + sink.recovered
    if total(reported) != sum(windows) + reported.recovered:
        assert sink.error is not None
    if 0 < fails_at <= len(windows):
        assert sink.error == "full"


def test_a_live_sink_tells_by_how_much_its_figures_are_off() -> None:
    sink = SinkThread("outputs[0]", "liar", Liar(Delivery(delivered=7)))
    sink.write(stub_window(5), threading.Event())
    until(lambda: sink.status().queued_windows == 0 and sink.status().delivered == 5)
    assert sink.status().unbalanced >= 2
    sink.close(time.monotonic() + 60.0)
    reported = sink.status()
    assert (reported.given, reported.delivered, reported.dropped) == (5, 5, 0)
    assert "do not add up, by 2 events" in (reported.error or "")


def test_events_of_a_sink_that_does_not_close_are_undelivered() -> None:
    ending = threading.Event()

    class Holding(Sink):
        def write(self, window: Window) -> None:
            """Take it."""

        def close(self) -> Delivery:
            ending.wait(60.0)
            return Delivery(delivered=5)

    sink = SinkThread("outputs[0]", "holding", Holding())
    sink.write(stub_window(5), threading.Event())
    until(lambda: sink.status().queued_windows == 0 and sink.status().delivered == 5)
    sink.close(time.monotonic() + 0.2)
    reported = sink.status()
    ending.set()
    assert (reported.delivered, reported.dropped, reported.state) == (0, 5, "failed")
    assert reported.error == "it did not close before the deadline"
