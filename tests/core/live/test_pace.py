"""A live run and the clock: a run that is late."""

import time

import pytest

from opir_core.live.loops import Pace

NS = 1_000_000_000


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
