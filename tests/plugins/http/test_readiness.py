"""Whether the service is ready while the backlog of a sink grows, stays or shrinks."""

from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from opir_http import service
from opir_http.settings import HttpSettings
from opir_testing import VerticalTargets, stub_plan, stub_scene, stub_sensor


class RunWithBacklog:
    """A run with one sink, whose backlog is set."""

    def __init__(self) -> None:
        target = VerticalTargets(*(np.array([value]) for value in (0.0, 5.0, 1.0, 9.0)))
        self.scene = stub_scene()
        self.plan = stub_plan([stub_sensor("A", 0.0)], target, ["T1"], self.scene)
        self.spooled = self.queued = 0

    def status(self) -> Any:
        sink = SimpleNamespace(
            path="outputs[0]", state="open", error=None, spooled=self.spooled, queued_windows=self.queued
        )
        return SimpleNamespace(state="running", sinks=(sink,))

    def progress(self) -> Any:
        return SimpleNamespace(delays=[])


@pytest.mark.parametrize("kept_in", ["spooled", "queued"])
def test_a_backlog_that_grew_at_three_looks_is_not_ready_until_it_shrinks(
    kept_in: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(service, "LOOK_S", 0.0)
    run: Any = RunWithBacklog()
    served = service.Service(run, HttpSettings())
    found = []
    for waiting in (0, 1, 2, 2, 3, 4, 3, 3, 4, 5, 0, 1):
        setattr(run, kept_in, waiting)
        found.append(served.is_ready()[0])
    assert found == [True, True, True, True, False, False, True, True, True, True, True, True]


def test_between_two_looks_a_backlog_is_judged_by_the_last() -> None:
    run: Any = RunWithBacklog()
    served = service.Service(run, HttpSettings())
    for run.spooled in range(10):
        assert served.is_ready() == (True, [])
