"""A run in several processes: the same bytes as in one, whatever dies, and one clear message for
what is wrong.
"""

import multiprocessing
import os
import signal
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from attrs import fields

import opir_core as opir
from opir_core import Engine, Plan, compile_plan
from opir_core.cli.main import main
from opir_core.errors import ModelError, SceneError
from opir_core.output import deliver
from opir_core.plugin import Detections, Window
from opir_core.simulation import run, workers
from opir_core.simulation.hit_stages import CountDetections
from opir_core.simulation.shared_run import counted
from opir_core.simulation.summary import Tally
from opir_core.simulation.workers import LostWindowError

pytestmark = pytest.mark.skipif(not hasattr(os, "fork"), reason="needs copies of processes")

#: What is added to the scene: nothing, what crosses windows, what is done in the parent.
SCENES: dict[str, dict[str, Any]] = {
    "constant": {},
    "confirmed": {
        "detection": {"model": "snr"},
        "sensor": {"confirmation_detections": 3, "confirmation_scans": 5},
    },
    "false alarms": {"detection": {"model": "snr"}, "sensor": {"confirmation_detections": 1}},
    "late": {"sensor": {"reporting": {"downlink": {"mean_s": 0.9, "sigma_s": 0.3}}}},
    "tracked": {"tracker": "kepler-arc"},
    "two outputs": {"outputs": [{"jsonl": {"path": "a.jsonl"}}, {"null": {}}]},
}


def plan_of(added: dict[str, Any]) -> Plan:
    remaining = dict(added)
    sensor = remaining.pop("sensor", {})
    return compile_plan(
        opir.scene_from_mapping(
            {
                "scene": "shared",
                "epoch": "2026-04-01T00:00:00Z",
                "duration_s": 60.0,
                "seed": 5,
                "sensors": [
                    {
                        "model": "SBIRS-GEO",
                        "id": f"S{slot}",
                        "orbital_slot_deg": slot,
                        "scan_period_ms": 150.0,
                        **sensor,
                    }
                    for slot in (-20.0, 10.0, 60.0)
                ],
                "targets": [
                    {
                        "id": f"T{number}",
                        "type": "ICBM",
                        "launch": {
                            "lat_deg": 20.0 + number,
                            "lon_deg": 10.0 * number,
                            "time_s": 2.0 * number,
                        },
                        "aim": {"lat_deg": -20.0, "lon_deg": 90.0},
                    }
                    for number in range(4)
                ],
                "outputs": [{"jsonl": {"path": "events.jsonl"}}],
                **remaining,
            }
        )
    )


@pytest.fixture(autouse=True)
def many_windows(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    monkeypatch.setattr(run, "LOOKS_PER_WINDOW", 900)
    monkeypatch.chdir(tmp_path)


@pytest.fixture(autouse=True)
def nothing_is_left() -> Any:
    yield
    assert not multiprocessing.active_children()


def written(plan: Plan, count: int, **pieces: Any) -> dict[str, bytes]:
    """Return the files of a run, by name."""
    tracks = None if plan.make_tracker().cadence_s is None else Path("tracks.jsonl")
    paths = {
        "truth_path": Path("truth.jsonl"),
        "manifest_path": Path("manifest.json"),
        "tracks_path": tracks,
    }
    outcome = deliver(plan, workers=count, **paths, **pieces)
    outcome.raise_for_failures()
    contents = {path.name: path.read_bytes() for path in Path().iterdir()}
    return {**contents, "summary": repr(outcome.summary).encode()}


#: A tracker takes seconds.
TRACKED_IS_SLOW = [
    pytest.param(name, marks=pytest.mark.slow if name == "tracked" else ()) for name in SCENES
]


@pytest.mark.slow
@pytest.mark.parametrize("name", TRACKED_IS_SLOW)
@pytest.mark.parametrize("count", [2, pytest.param(3, marks=pytest.mark.slow)])
def test_the_files_are_the_same_with_any_number_of_workers(name: str, count: int) -> None:
    plan = plan_of(SCENES[name])
    alone = written(plan, 1)
    assert len(alone["truth.jsonl"].splitlines()) > 500
    assert written(plan, count) == alone


def test_the_columns_in_memory_are_the_same() -> None:
    plan = plan_of({})
    first_run = opir.run_of_plan(plan)
    two = opir.run_of_plan(plan, workers=2)
    for column in fields(Detections):
        actual = getattr(first_run.detections, column.name)
        expected = getattr(two.detections, column.name)
        assert np.array_equal(actual, expected, equal_nan=actual.dtype.kind == "f")
    assert first_run.manifest == two.manifest


def test_text_without_room_in_the_buffer_is_the_same(monkeypatch: pytest.MonkeyPatch) -> None:
    plan = plan_of({})
    alone = written(plan, 1)
    monkeypatch.setattr(workers, "BUFFER_BYTES", 100_000)
    assert written(plan, 2) == alone


def dying(monkeypatch: pytest.MonkeyPatch, times: int, at: str) -> Path:
    """Let the worker of the window at 20 s be killed a number of times: before its turn, in it, or
    after it.
    """
    flag = Path("deaths")
    observe = Engine.observe
    counted = CountDetections._counted
    expected = set()

    def kill() -> None:
        deaths = len(flag.read_bytes()) if flag.exists() else 0
        if deaths < times:
            flag.write_bytes(b"x" * (deaths + 1))
            os.kill(os.getpid(), signal.SIGKILL)

    def killed(engine: Engine, start_ns: int, end_ns: int, turn: Any) -> Window:
        expected.clear()
        if start_ns <= 20_000_000_000 < end_ns:
            expected.add(at)
        if "before" in expected:
            kill()
        window = observe(engine, start_ns, end_ns, turn)
        if "after" in expected:
            kill()
        return window

    def killed_in_turn(count: CountDetections, *arguments: Any) -> Any:
        result = counted(count, *arguments)
        if "in" in expected:
            kill()
        return result

    monkeypatch.setattr(Engine, "observe", killed)
    monkeypatch.setattr(CountDetections, "_counted", killed_in_turn)
    return flag


@pytest.mark.slow
@pytest.mark.parametrize("at", ["before", "in", "after"])
def test_a_killed_worker_costs_time_and_no_result(at: str, monkeypatch: pytest.MonkeyPatch) -> None:
    plan = plan_of(SCENES["constant"])
    alone = written(plan, 1)
    flag = dying(monkeypatch, 2, at)
    repeat = written(plan, 2)
    assert repeat.pop(flag.name) == b"xx"
    assert repeat == alone


def test_a_window_that_kills_its_workers_ends_the_run(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    dying(monkeypatch, 99, "before")
    with pytest.raises(
        LostWindowError, match=r"window from [\d.]+ to [\d.]+ s ended 3 times.*fewer workers"
    ):
        written(plan_of({}), 2)
    assert not Path("events.jsonl").exists()


def test_what_a_worker_raises_is_raised_when_its_window_is_due(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    observe = Engine.observe
    records: list[float] = []

    def wrong(engine: Engine, start_ns: int, end_ns: int, turn: Any) -> Window:
        if end_ns > 30_000_000_000:
            raise ModelError("the model of Smith returned nonsense")
        return observe(engine, start_ns, end_ns, turn)

    monkeypatch.setattr(Engine, "observe", wrong)
    with pytest.raises(ModelError, match="the model of Smith returned nonsense"):
        written(plan_of({}), 2, on_window=lambda window: records.append(window.end_s))
    assert 20.0 < records[-1] <= 30.0


def test_an_interrupt_ends_the_workers_and_leaves_no_file() -> None:
    def interrupt(_window: Window) -> None:
        raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        written(plan_of({}), 2, on_window=interrupt)
    assert not list(Path().iterdir())


def test_the_summary_needs_no_other_columns_than_are_sent() -> None:
    plan = plan_of(SCENES["false alarms"])

    def summary(change: Callable[[Window], Window]) -> Any:
        tally = Tally(plan)
        list(tally.over(map(change, opir.plan_windows(plan))))
        return tally.summary()

    assert summary(counted) == summary(lambda window: window)


@pytest.mark.parametrize("count", [0, -1])
def test_a_number_of_workers_below_one_is_refused(count: int) -> None:
    with pytest.raises(
        SceneError, match=f"workers: {count} is not a number of processes; give 1 or more"
    ):
        opir.run_of_plan(plan_of({}), workers=count)


def test_a_system_without_fork_says_so(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(workers, "get_all_start_methods", lambda: ["spawn"])
    with pytest.raises(SceneError, match="this system cannot copy a process"):
        opir.run_of_plan(plan_of({}), workers=2)


def test_a_live_service_refuses_workers(capsys: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(SystemExit):
        main(["serve", "scene.yaml", "--workers", "2"])
    assert (
        "--workers: a live service runs in one process; omit it, or use opir run"
        in capsys.readouterr().err
    )
