"""Whether the service is ready while the backlog of a sink grows, stays or shrinks."""

import threading
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from opir_http import health, service
from opir_http.settings import HttpSettings
from opir_testing import VerticalTargets, stub_plan, stub_scene, stub_sensor
from waiting import until


class RunWithBacklog:
    """A run with one sink, whose backlog is set."""

    def __init__(self) -> None:
        target = VerticalTargets(*(np.array([value]) for value in (0.0, 5.0, 1.0, 9.0)))
        self.scene = stub_scene()
        self.plan = stub_plan([stub_sensor("A", 0.0)], target, ["T1"], self.scene)
        self.spooled = 0
        self.queued = 0
        self.attempts = 0
        self.state = "open"
        self.error = None

    def status(self) -> Any:
        sink = SimpleNamespace(
            path="outputs[0]",
            state=self.state,
            error=self.error,
            attempts=self.attempts,
            spooled=self.spooled,
            queued_windows=self.queued,
        )
        return SimpleNamespace(state="running", sinks=(sink,), cycle_age_s=0.01)

    def progress(self) -> Any:
        return SimpleNamespace(delays=[], stuck=[])


@pytest.mark.parametrize("kept_in", ["spooled", "queued"])
def test_a_backlog_that_grew_at_three_looks_is_not_ready_until_it_shrinks(
    kept_in: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(health, "LOOK_S", 0.0)
    run: Any = RunWithBacklog()
    served = service.Service(run, HttpSettings())
    found = []
    for waiting in (0, 1, 2, 2, 3, 4, 3, 3, 4, 5, 0, 1):
        setattr(run, kept_in, waiting)
        found.append(served.health().ready)
    assert found == [True, True, True, True, False, False, True, True, True, True, True, True]


def test_between_two_looks_a_backlog_is_judged_by_the_last() -> None:
    run: Any = RunWithBacklog()
    served = service.Service(run, HttpSettings())
    for run.spooled in range(10):
        assert served.health().ready


@pytest.mark.parametrize(
    ("state", "reported"),
    [
        ("open", "the sink outputs[0] delivers nothing: no broker (failed attempts: 3)"),
        (
            "parked",
            "the sink outputs[0] is refused and keeps its events: no broker (failed attempts: 3)",
        ),
        ("failed", "the sink outputs[0] has failed: no broker"),
    ],
)
def test_the_reason_and_the_attempts_of_a_sink_are_reported_in_each_state(
    state: str, reported: str
) -> None:
    run: Any = RunWithBacklog()
    run.state = state
    run.error = "no broker"
    run.attempts = 0 if state == "failed" else 3
    found = service.Service(run, HttpSettings()).health()
    assert (found.ready, found.alive, found.reasons) == (False, True, (reported,))


def test_the_log_says_once_why_a_service_is_not_ready_and_when_it_is_again(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr(health, "LOOK_S", 0.01)
    said = list[str]()
    looks = list[int]()
    stopping = threading.Event()
    monkeypatch.setattr(health, "warn", said.append)

    def found() -> health.Health:
        looks.append(0)
        reasons = [f"no cycle for {len(looks)}.5 s"] if len(looks) < 20 else []
        return health.Health.of(reasons, [], 0.0, None)

    health.log_health(found, stopping)
    until(lambda: len(looks) > 25)
    stopping.set()
    assert said == ["not ready: no cycle for 1.5 s", "ready again"]


def test_the_log_has_each_output_once_whatever_its_figures_and_nothing_of_a_run_that_was_stopped(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr(health, "LOOK_S", 0.01)
    said = list[str]()
    stopping = threading.Event()
    monkeypatch.setattr(health, "warn", said.append)
    lost = "the sink outputs[{}].kafka delivers nothing: no broker{}"
    looks = iter(
        [
            [lost.format(0, ""), lost.format(1, "")],
            [lost.format(0, " (failed attempts: 3)"), lost.format(1, " (failed attempts: 12)")],
            [health.STOPPED],
        ]
    )
    threads = set(threading.enumerate())
    health.log_health(lambda: health.Health.of(next(looks), [], 0.0, None), stopping)
    until(lambda: set(threading.enumerate()) <= threads)
    assert said == [f"not ready: {lost.format(number, '')}" for number in (0, 1)]


def test_a_run_that_starts_says_so() -> None:
    run: Any = RunWithBacklog()
    run.status = lambda: SimpleNamespace(state="starting", sinks=(), cycle_age_s=0.0)
    assert service.Service(run, HttpSettings()).health().reasons == ("the run is starting",)
