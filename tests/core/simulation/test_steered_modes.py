"""Sensors that look at their whole field of regard until a command names a mode."""

import json
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from directed_spot import columns, host_of
from two_sensor_scene import two_sensor_scene

import opir_core as opir
from opir_core.live import LiveRun, LiveSettings
from opir_core.output import CommandsFile, deliver
from opir_core.output.run_files import read_commands
from opir_core.plugin import Command, Situation
from opir_core.reading import scene_mapping

LAUNCH_M = np.array([-2.6536e6, -4.5963e6, 3.5470e6])
#: Beyond the six degrees across of a sector about the launch.
FAR = {"id": "T2", "type": "ICBM", "launch": {"lat_deg": -40.0, "lon_deg": -90.0, "time_s": 0.0}}
FAR["aim"] = {"lat_deg": 20.0, "lon_deg": -90.0}
WIDE: Mapping[str, Any] = {
    "model": "SBIRS-GEO",
    "id": "WIDE",
    "orbital_slot_deg": -100.0,
    "detection_probability": {"ICBM": 1.0},
    "modes": "notional",
}
ORDERS: Mapping[float, Mapping[str, Any]] = {
    20.0: {"position_ecef_m": LAUNCH_M, "mode": "sector"},
    60.0: {"mode": "survey"},
}


def decide(situation: Situation) -> Sequence[Command]:
    orders = ORDERS.get(situation.time_s)
    return [] if orders is None else [Command(sensor="WIDE", **orders)]


def scene(director: Any = "script", wide: Mapping[str, Any] = WIDE, **changes: Any) -> opir.Scene:
    targets = [*two_sensor_scene()["targets"], FAR]
    settings = {"duration_s": 100.0, "sensors": [wide], "targets": targets, **changes}
    directed = {} if director is None else {"director": director}
    mapping = two_sensor_scene(**settings, **directed)
    return opir.scene_from_mapping(mapping, host=host_of(decide))


@pytest.fixture(scope="module")
def run() -> opir.Run:
    return opir.simulate(scene(), host_of(decide))


def seen_s(result: opir.Run, target: int) -> Any:
    return result.detections.time_s[result.truth.target == target]


def test_a_sector_is_looked_at_five_times_as_often_and_nothing_else_is(run: opir.Run) -> None:
    into, back = run.commands
    assert (into.start_s, back.start_s, back.from_s) == (21.0, 61.0, 62.0)
    near_s = seen_s(run, 0)
    inside = near_s[(near_s >= into.from_s) & (near_s < back.start_s)]
    np.testing.assert_allclose(np.diff(inside), 0.02, atol=1e-9)
    assert inside[0] - into.from_s < 0.02
    far_s = seen_s(run, 1)
    assert not np.count_nonzero((far_s >= into.start_s) & (far_s < back.from_s))
    np.testing.assert_allclose(np.diff(far_s[far_s > back.from_s]), 0.1, atol=1e-9)


def test_before_the_command_it_detects_what_it_does_without_modes(run: opir.Run) -> None:
    plain = opir.simulate(scene(None, {**WIDE, "modes": "none"}))
    detections, plain_early = (
        each.detections.take(np.flatnonzero(each.detections.time_s < 21.0)) for each in (run, plain)
    )
    for name in ("time_ns", "line_of_sight_ecef", "detection_id", "detection_count"):
        np.testing.assert_array_equal(getattr(detections, name), getattr(plain_early, name))


def test_it_watches_only_while_it_surveys(run: opir.Run, tmp_path: Path) -> None:
    spans = [[0.0, 21.0], [62.0, 100.0]]
    assert run.manifest["watched_s"]["WIDE"] == spans
    path = tmp_path / "e.jsonl"
    outputs = [{"jsonl": {"path": str(path), "heartbeat_s": 10.0}}]
    deliver(opir.compile_plan(scene(outputs=outputs), host_of(decide)))
    beats = [
        line
        for line in map(json.loads, path.read_text().splitlines())
        if line.get("record") == "heartbeat"
    ]
    edges = [(beat["watched_from"][17:19], beat["watched_to"][17:19]) for beat in beats]
    assert edges[:3] == [("00", "10"), ("10", "20"), ("20", "21")]
    assert edges[3] == ("02", "10")


def test_the_tracker_knows_when_it_surveys(monkeypatch: pytest.MonkeyPatch) -> None:
    plan = opir.compile_plan(scene(tracker="none"), host_of(decide))
    assert plan.tracker_sensors()[0].watched_s is None
    notices: list[Any] = []
    engine = opir.Engine(plan)
    monkeypatch.setattr(engine._tracker, "set_sensors", notices.append)
    engine.advance(100_000_000_000)
    assert [sensors[0].watched_s for sensors in notices] == [
        ((0.0, 21.0),),
        ((0.0, 21.0), (62.0, 100.0)),
    ]


@pytest.mark.parametrize("window_s", [0.7, 33.0])
def test_windows_change_no_byte(run: opir.Run, window_s: float) -> None:
    sliced = opir.simulate(scene(), host_of(decide), window_s=window_s)
    for one, other in zip(columns(run), columns(sliced), strict=True):
        np.testing.assert_array_equal(one, other)
    assert run.manifest["watched_s"] == sliced.manifest["watched_s"]


def test_a_scene_without_modes_is_as_it_was() -> None:
    plain = scene(None, {key: value for key, value in WIDE.items() if key != "modes"})
    (written,) = scene_mapping(plain)["sensors"]
    assert not {"modes", "pointing"} & set(written)
    assert opir.scene_from_mapping(scene_mapping(plain)) == plain
    assert opir.compile_plan(plain).sensors[0].pointing is None
    (named,) = scene_mapping(scene())["sensors"]
    assert set(named["modes"]) == {"survey", "sector", "stare"}


def test_without_modes_it_takes_no_commands() -> None:
    with pytest.raises(opir.SceneError, match="no sensor of the scene has a narrow field"):
        opir.compile_plan(scene("operator", {**WIDE, "modes": "none"}))


@pytest.mark.parametrize(
    ("mode", "is_refused"),
    [
        # (1 - cos 5) / (1 - cos 10) of the solid angle in the same share of 100 ms: 25.05 ms.
        ({"half_angle_deg": 5.0, "scan_period_ms": 25.0}, True),
        ({"half_angle_deg": 5.0, "scan_period_ms": 25.1}, False),
        ({"half_angle_deg": 5.0, "scan_period_ms": 50.1, "integration_time_ms": 20.0}, False),
        ({"half_angle_deg": 5.0, "scan_period_ms": 50.0, "integration_time_ms": 20.0}, True),
    ],
)
def test_a_mode_is_no_faster_than_the_scan(mode: Mapping[str, Any], is_refused: bool) -> None:
    of_scene = scene("operator", {**WIDE, "modes": {"fast": mode}})
    if not is_refused:
        opir.compile_plan(of_scene)
        return
    with pytest.raises(opir.SceneError, match=r"sensors\[0\]\.modes\.fast: 5 deg in \d+ ms"):
        opir.compile_plan(of_scene)


@pytest.mark.parametrize("model", ["SBIRS-GEO", "NEXTGEN-GEO"])
def test_notional_modes_keep_to_the_scan(model: str) -> None:
    plan = opir.compile_plan(scene("operator", {**WIDE, "model": model}))
    assert sorted(plan.sensors[0].modes) == ["sector", "stare", "survey"]


def test_a_live_run_writes_the_same_commands(run: opir.Run, tmp_path: Path) -> None:
    live = LiveRun(scene(outputs=["null"]), host_of(decide), LiveSettings(speed=None))
    path = tmp_path / "e.commands.jsonl"
    live.commands_file = CommandsFile(path)
    live.start()
    live._thread.join()
    live.stop()
    assert read_commands(path) == list(run.commands)
