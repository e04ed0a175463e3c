"""A live run is repeated from its changes, byte for byte: launches, settings, tasks, laps, kills."""

import json
import random
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import pytest
from waiting import until

from opir_core.cli.main import main
from opir_core.errors import OpirError, SceneError
from opir_core.live import ChangesFile, LiveRun, LiveSettings, SensorTask, repeated_run
from opir_core.plugin import Host
from opir_core.reading import scene_from_mapping

SCENE: Mapping[str, Any] = {
    "scene": "repeated",
    "epoch": "2026-04-01T12:00:00Z",
    "duration_s": 90,
    "seed": 3,
    "sensors": [{"constellation": "DSP"}, {"constellation": "SBIRS-GEO"}],
    "targets": [],
    "detection": "constant",
}


@pytest.fixture(scope="module")
def host() -> Host:
    return Host.discover()


def live_run(folder: Path, host: Host, settings: LiveSettings, **more: Any) -> LiveRun:
    outputs = [{"jsonl": {"path": str(folder / "e.jsonl")}}]
    scene = scene_from_mapping({**SCENE, **more, "outputs": outputs}, host=host)
    run = LiveRun(scene, host, settings)
    run.changes_file = ChangesFile(folder / "e.changes.jsonl", scene, loop=settings.loop)
    return run


def changed_at_random(run: LiveRun, launches: int, settings: int) -> None:
    """Launch targets and change settings at random moments; refusals are none of this test."""
    draws = random.Random(7)
    kinds = ["launch"] * launches + ["settings"] * settings
    draws.shuffle(kinds)
    for kind in kinds:
        try:
            if kind == "launch":
                place = {"lat_deg": draws.uniform(-50, 50), "lon_deg": draws.uniform(-130, -70)}
                aim = {**place, "lat_deg": place["lat_deg"] + 4.0}
                run.launch({"type": draws.choice(["SRBM", "IRBM"]), "launch": place, "aim": aim})
            else:
                mapping = run.settings_mapping()
                member = mapping["sensors"][draws.randrange(2)]["members"][0]
                member["scan_period_ms"] = draws.choice([100.0, 200.0, 400.0, 1000.0])
                run.configure(mapping)
        except OpirError:
            continue


def pointed_run(folder: Path, host: Host, **more: Any) -> LiveRun:
    """Return a run with the sensor SPOT, which only an operator points."""
    modes = {"sector": {"half_angle_deg": 3.0, "scan_period_ms": 700.0}}
    spot = {"model": "generic-pointed", "id": "SPOT", "orbital_slot_deg": -100.0, "modes": modes}
    more = {"director": "operator", "sensors": [spot], **more}
    return live_run(folder, host, LiveSettings(speed=20.0, late_after_s=60.0), **more)


def repeated_events(folder: Path) -> bytes:
    again = folder / "again.jsonl"
    assert main(["run", str(folder / "e.changes.jsonl"), "-o", str(again), "--quiet"]) == 0
    return again.read_bytes()


@pytest.mark.slow
@pytest.mark.parametrize("tracker", ["none", "imm"])
def test_launches_and_settings_are_repeated(tracker: str, host: Host, tmp_path: Path) -> None:
    settings = LiveSettings(speed=5.0, cycle_ns=50_000_000, late_after_s=60.0)
    run = live_run(tmp_path, host, settings, tracker=tracker)
    run.start()
    changed_at_random(run, 12, 6)
    until(lambda: run.state == "ended", within_s=60.0)
    run.stop()
    lines = (tmp_path / "e.changes.jsonl").read_text(encoding="utf-8").splitlines()
    kinds = [next(iter(set(json.loads(line)) & {"launch", "settings"}), "") for line in lines]
    assert kinds.count("launch") > 1
    assert kinds.count("settings") > 0
    events = (tmp_path / "e.jsonl").read_bytes()
    assert events.count(b"\n") > 100
    assert repeated_events(tmp_path) == events


@pytest.mark.slow
def test_laps_and_the_moment_of_the_stop_are_repeated(host: Host, tmp_path: Path) -> None:
    settings = LiveSettings(speed=40.0, cycle_ns=25_000_000, loop=True, late_after_s=60.0)
    run = live_run(tmp_path, host, settings, duration_s=30)
    run.start()
    changed_at_random(run, 8, 2)
    until(lambda: run.status().lap >= 2, within_s=60.0)
    run.stop()
    events = (tmp_path / "e.jsonl").read_bytes()
    assert events.count(b"\n") > 50
    assert repeated_events(tmp_path) == events


@pytest.mark.slow
def test_a_killed_run_is_repeated_as_far_as_it_came(host: Host, tmp_path: Path) -> None:
    settings = LiveSettings(speed=20.0, cycle_ns=50_000_000, late_after_s=60.0)
    run = live_run(tmp_path, host, settings)
    run.start()
    changed_at_random(run, 4, 0)
    until(lambda: run.state == "ended", within_s=60.0)
    run.stop()
    changes = tmp_path / "e.changes.jsonl"
    lines = changes.read_bytes().splitlines(keepends=True)
    changes.write_bytes(b"".join(lines[:-1]) + lines[-2][:40])  # as a kill leaves it
    events = (tmp_path / "e.jsonl").read_bytes()
    assert repeated_events(tmp_path) == events


@pytest.mark.parametrize("mode", ["", "sector"])
def test_tasks_of_sensors_are_repeated(mode: str, host: Host, tmp_path: Path) -> None:
    place = {"lat_deg": 34.73, "lon_deg": -120.57}
    launch = {**place, "time_s": 1.0}
    target = {
        "id": "T",
        "type": "ICBM",
        "launch": launch,
        "aim": {"lat_deg": 9.0, "lon_deg": 167.7},
    }
    run = pointed_run(tmp_path, host, targets=[target])
    run.start()
    launch_point_m = [-2669e3, -4519e3, 3613e3]
    task = SensorTask(sensor="SPOT", position_ecef_m=launch_point_m, mode=mode)
    assert not run.task(task).refusal
    until(lambda: run.state == "ended", within_s=60.0)
    run.stop()
    events = (tmp_path / "e.jsonl").read_bytes()
    assert events.count(b"SPOT") > 5
    assert (b'"mode"' in (tmp_path / "e.changes.jsonl").read_bytes().splitlines()[1]) == bool(mode)
    assert repeated_events(tmp_path) == events


def test_who_gives_a_task_that_fails_is_answered(
    host: Host, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("opir_core.simulation.engine.Engine.task", lambda *_: 1 / 0)
    run = pointed_run(tmp_path, host)
    run.start()
    with pytest.raises(OpirError, match="the run has failed: ZeroDivisionError"):
        run.task(SensorTask(sensor="SPOT"))
    assert run.stop().state == "failed"


@pytest.mark.parametrize(
    ("line", "message"),
    [
        ('{"lap":0}', "line 2: no launch, settings or task with lap and time_ns"),
        ('{"lap":0,"time_ns":"1","launch":{}}', "line 2: no launch, settings or task"),
        ('{"end_ns":null}', "line 2: no launch, settings or task"),
        ('{"lap":0,"time_ns":-1,"task":{}}', "line 2: no launch, settings or task"),
        (
            '{"lap":1,"time_ns":0,"task":{}}\n{"lap":0,"time_ns":9,"task":{}}',
            "not in the order of lap",
        ),
        ("[1]", "line 2: not a change"),
        ("{", "line 2: not a change"),
    ],
)
def test_another_line_is_refused(line: str, message: str, host: Host, tmp_path: Path) -> None:
    scene = scene_from_mapping(SCENE, host=host)
    path = tmp_path / "e.changes.jsonl"
    ChangesFile(path, scene, loop=False).end(0)
    path.write_text(path.read_text().splitlines()[0] + f"\n{line}\n")
    with pytest.raises(SceneError, match=message):
        repeated_run(path, [], host)


def test_a_later_version_is_refused_by_name(host: Host, tmp_path: Path) -> None:
    path = tmp_path / "e.changes.jsonl"
    path.write_text('{"changes_version": "2.0", "scene": {}}\n')
    with pytest.raises(SceneError, match=r"of changes version 2\.0, where 1\.x is read"):
        repeated_run(path, [], host)


def test_the_command_asks_where_to(
    host: Host, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    path = tmp_path / "e.changes.jsonl"
    ChangesFile(path, scene_from_mapping(SCENE, host=host), loop=False).end(0)
    assert main(["run", str(path)]) == 2
    assert "give -o PATH or --sink NAME" in capsys.readouterr().err
    out = str(tmp_path / "again.jsonl")
    assert main(["run", str(path), "-o", out, "--truth", "t.jsonl"]) == 2
    assert "--truth" in capsys.readouterr().err


def test_an_end_without_a_newline_is_read(host: Host, tmp_path: Path) -> None:
    path = tmp_path / "e.changes.jsonl"
    ChangesFile(path, scene_from_mapping(SCENE, host=host), loop=True).end(5)
    path.write_bytes(path.read_bytes().rstrip())
    assert repeated_run(path, [], host).scene.name == "repeated"


def test_an_end_that_the_disk_does_not_take_is_a_warning(
    host: Host, tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    run = live_run(tmp_path, host, LiveSettings(speed=None))
    with Path("/dev/full").open("wb", buffering=0) as full:
        changes: Any = run.changes_file
        changes._file.close()
        changes._file = full
        run.start()
        until(lambda: caplog.records)
    assert "the end of the run is not in it" in caplog.text
    assert run.stop().state == "stopped"
