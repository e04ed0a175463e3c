"""A live run and the clock: viewers that are slow, and a run that is behind."""

import time

import pytest

from opir_core.live.broadcast import Viewer
from opir_core.live.pace import Pace

NS = 1_000_000_000


def test_a_slow_viewer_loses_the_oldest_and_knows_how_many() -> None:
    viewer: Viewer[int] = Viewer(3)
    for number in range(10):
        viewer.put(number)
    assert [viewer.take(0.0) for _ in range(4)] == [7, 8, 9, None]
    assert viewer.dropped == 7
    viewer.close()
    assert viewer.is_over


def test_a_run_that_is_behind_takes_more_in_at_a_time(monkeypatch: pytest.MonkeyPatch) -> None:
    moment = [10 * NS]
    monkeypatch.setattr(time, "monotonic_ns", lambda: moment[0])
    pace = Pace(2.0, 50_000_000)
    pace.start()
    assert pace.step_ns(0) == 100_000_000
    moment[0] += NS // 2
    assert pace.late_ns(NS) == 0
    assert pace.step_ns(NS // 2) == 500_000_000
    moment[0] += 100 * NS
    assert pace.step_ns(NS) == 20 * 100_000_000
