"""A live run is watched: calls that hang or end their thread are noticed meanwhile, finished cycles
are reported.
"""

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import pytest
from live_scene import mapping
from rogue_components import Hang, raising, rogue_host
from waiting import until

from opir_core.live import LiveRun, LiveSettings
from opir_core.plugin import Host
from opir_core.reading import scene_from_mapping

QUICK = LiveSettings(speed=50.0, cycle_ns=10_000_000, unready_after_s=0.2, dead_after_s=0.6)

PARTS = {
    "tracker": ("opir_trackers", "kepler-arc", "step", {"tracker": "rogue"}),
    "model": ("opir_detection_models", "constant", "pair_probability", {"detection": "rogue"}),
    "confidence": ("opir_confidence_models", "weighted", "confidence", {"confidence": "rogue"}),
    "sink": ("opir_sinks", "memory", "write", {"outputs": [{"rogue": {}}, "null"]}),
}


@contextmanager
def running(host: Host, settings: LiveSettings = QUICK, **changes: Any) -> Iterator[LiveRun]:
    run = LiveRun(scene_from_mapping(mapping(**changes), host=host), host, settings)
    run.start()
    try:
        yield run
    finally:
        run.stop(within_s=0.5)


@pytest.mark.slow
@pytest.mark.parametrize("part", PARTS)
def test_a_call_that_hangs_is_noticed_while_it_lasts(part: str) -> None:
    hook, sound, method, changes = PARTS[part]
    hang = Hang()
    with running(rogue_host(hook, sound, method, hang), **changes) as run:
        try:
            until(hang.begun.is_set)
            until(lambda: run.progress().delays)
            assert run.state == "running"
            until(lambda: run.progress().stuck)
            assert "rogue_components.py, line" in run.progress().stuck[0]
            assert (run.status().sinks[0].busy_s > 0.5) == (part == "sink")
        finally:
            hang.end()


def test_a_hanging_sink_is_named_while_the_engine_goes_on() -> None:
    hang = Hang()
    with running(rogue_host("opir_sinks", "memory", "write", hang), outputs=[{"rogue": {}}]) as run:
        try:
            until(hang.begun.is_set)
            cycle = run.status().cycle
            named = "the sink outputs[0] has not returned for "
            until(lambda: any(reason.startswith(named) for reason in run.progress().stuck))
            until(lambda: run.status().cycle > cycle)
        finally:
            hang.end()


@pytest.mark.slow
@pytest.mark.parametrize(
    "error", [SystemExit(0), GeneratorExit(), KeyboardInterrupt(), MemoryError("all")]
)
@pytest.mark.parametrize("part", PARTS)
def test_whatever_a_component_raises_is_reported(part: str, error: BaseException) -> None:
    hook, sound, method, changes = PARTS[part]
    with running(rogue_host(hook, sound, method, raising(error)), **changes) as run:
        if part == "sink":
            until(lambda: run.status().sinks[0].state == "failed")
            reported = run.status().sinks[0].error or ""
            state = "running"
            until(lambda: run.status().sinks[1].delivered > 0)
        elif part == "tracker":
            until(lambda: run.status().tracker_error is not None)
            reported = run.status().tracker_error or ""
            state = "running"
        else:
            until(lambda: run.state == "failed")
            reported = run.status().error or ""
            state = "failed"
        assert run.state == state
        assert type(error).__name__ in reported
        assert "rogue_components.py, line" in reported


@pytest.mark.slow
def test_waiting_for_a_full_spool_is_not_stuck(tmp_path: Path) -> None:
    spool = {"path": str(tmp_path / "spool"), "when_full": "wait", "wait_s": 300.0}
    hang = Hang()
    host = rogue_host("opir_trackers", "kepler-arc", "step", hang)
    outputs = [{"jsonl": {"path": str(tmp_path / "events"), "spool": spool}}]
    with running(host, tracker="rogue", outputs=outputs) as run:
        try:
            until(lambda: run.progress().cycle_age_s > 1.0)
            assert run.progress().delays
            assert not run.progress().stuck
        finally:
            hang.end()


def test_who_asks_for_a_change_that_fails_gets_an_answer(monkeypatch: pytest.MonkeyPatch) -> None:
    from opir_core import Engine

    with running(Host.discover()) as run:
        monkeypatch.setattr(Engine, "take_over", lambda *_: raising(SystemExit(0))(None))
        with pytest.raises(Exception, match="the run has failed: SystemExit"):
            run.configure(run.settings_mapping() | {"confidence": "always"})
        until(lambda: run.state == "failed")
