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
        self.delivered = 0
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
            given=self.spooled + self.delivered,
            spooled=self.spooled,
            delivered=self.delivered,
            **dict.fromkeys(("dropped", "withheld", "recovered"), 0),
            queued_windows=self.queued,
        )
        return SimpleNamespace(state="running", sinks=(sink,), cycle_age_s=0.01)

    def progress(self) -> Any:
        return SimpleNamespace(delays=[], stuck=[])


@pytest.fixture
def run() -> Any:
    return RunWithBacklog()


@pytest.fixture
def served(run: Any) -> service.Service:
    return service.Service(run, HttpSettings())


@pytest.fixture
def messages(monkeypatch: pytest.MonkeyPatch) -> list[str]:
    """Messages of the log, which checks 100 times a second."""
    messages = list[str]()
    monkeypatch.setattr(health, "LOOK_S", 0.01)
    monkeypatch.setattr(health, "warn", messages.append)
    return messages


def reasons(*texts: str) -> Any:
    return SimpleNamespace(reasons=list(texts))


@pytest.mark.parametrize("place", ["spooled", "queued"])
def test_a_backlog_that_grew_three_times_is_not_ready(
    place: str, run: Any, served: service.Service, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(health, "LOOK_S", 0.0)
    ready = []
    for events in (0, 1, 2, 2, 3, 4, 3, 3, 4, 5, 0, 1):
        setattr(run, place, events)
        ready.append(served.health().ready)
    assert ready == [True, True, True, True, False, False, True, True, True, True, True, True]


@pytest.mark.parametrize(("rate", "is_ready"), [(50, True), (3, False)])
def test_what_is_as_little_as_an_output_takes_between_checks_is_no_backlog(
    rate: int, is_ready: bool, run: Any, served: service.Service, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(health, "LOOK_S", 0.0)
    for run.spooled in (1, 4, 6, 9, 12):
        run.delivered += rate
        state = served.health()
    assert state.ready is is_ready


def test_a_backlog_is_checked_once_a_second(run: Any, served: service.Service) -> None:
    for run.spooled in range(10):
        assert served.health().ready


@pytest.mark.parametrize(
    ("state", "reason"),
    [
        ("open", "the sink outputs[0] delivers nothing: no broker (failed attempts: 3)"),
        (
            "parked",
            "the sink outputs[0] is refused and keeps its events: no broker (failed attempts: 3)",
        ),
        ("failed", "the sink outputs[0] has failed: no broker"),
    ],
)
def test_each_state_of_a_sink_has_its_reason(
    state: str, reason: str, run: Any, served: service.Service
) -> None:
    run.state = state
    run.error = "no broker"
    run.attempts = 0 if state == "failed" else 3
    state_of_health = served.health()
    assert (state_of_health.ready, state_of_health.alive) == (False, True)
    assert state_of_health.reasons == [reason]


def test_the_log_has_a_reason_once_and_its_end(messages: list[str]) -> None:
    checks = list[int]()
    stopping = threading.Event()

    def present_health() -> Any:
        checks.append(0)
        return reasons(*([f"no cycle for {len(checks)}.5 s"] if len(checks) < 20 else []))

    health.log_health(present_health, stopping)
    until(lambda: len(checks) > 25)
    stopping.set()
    assert messages == ["not ready: no cycle for 1.5 s", "ready again"]


def test_the_log_ignores_figures_and_ends_with_the_run(messages: list[str]) -> None:
    text = "the sink outputs[{}].kafka delivers nothing: no broker{}"
    checks = iter(
        [
            reasons(text.format(0, ""), text.format(1, "")),
            reasons(
                text.format(0, " (failed attempts: 3)"), text.format(1, " (failed attempts: 12)")
            ),
            reasons(health.STOPPED),
        ]
    )
    threads = set(threading.enumerate())
    health.log_health(lambda: next(checks), threading.Event())
    until(lambda: set(threading.enumerate()) <= threads)
    assert messages == [f"not ready: {text.format(number, '')}" for number in (0, 1)]


def test_a_run_that_starts_is_not_ready(run: Any, served: service.Service) -> None:
    run.status = lambda: SimpleNamespace(state="starting", sinks=(), cycle_age_s=0.0)
    assert served.health().reasons == ["the run is starting"]
