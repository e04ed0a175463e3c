"""The exporter `scene`: a live run becomes a scene that makes the same events."""

import json
from collections.abc import Mapping
from contextlib import suppress
from pathlib import Path
from typing import Any

import pytest
import yaml
from command_line import main, run_command
from repository import EXAMPLES
from waiting import until

from opir_core.live import ChangesFile, LiveRun, LiveSettings, RefusedError
from opir_core.plugin import Host
from opir_core.reading import scene_from_mapping

LAUNCH = {
    "type": "SRBM",
    "launch": {"lat_deg": 11.0, "lon_deg": -100.0},
    "aim": {"lat_deg": 14.0, "lon_deg": -98.0},
}
SCENE: Mapping[str, Any] = {
    "scene": "recorded",
    "epoch": "2026-04-01T12:00:00Z",
    "duration_s": 60,
    "seed": 3,
    "sensors": [{"constellation": "DSP"}, {"constellation": "SBIRS-GEO"}],
    "targets": [{**LAUNCH, "id": "first", "launch": {**LAUNCH["launch"], "time_s": 1.0}}],
    "detection": "constant",
    "outputs": [{"jsonl": {"path": "events.jsonl"}}],
}


@pytest.fixture(autouse=True)
def here(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)


def recorded(*, loop: bool, tracker: str = "none") -> LiveRun:
    """Return a live run, started, whose files are in the present folder."""
    host = Host.discover()
    scene = scene_from_mapping({**SCENE, "tracker": tracker}, host=host)
    speed = 20.0 if loop else 5.0
    run = LiveRun(scene, host, LiveSettings(speed=speed, loop=loop, late_after_s=60.0))
    run.changes_file = ChangesFile(Path("events.changes.jsonl"), scene, loop=loop)
    run.start()
    return run


def launched(run: LiveRun, count: int) -> list[str]:
    """Launch targets and return their ids; after its end a run refuses more, on a slow machine."""
    ids = []
    for number in range(count):
        place = {"lat_deg": -20.0 + 8.0 * number, "lon_deg": -95.0}
        aim = {**place, "lat_deg": place["lat_deg"] + 4.0}
        with suppress(RefusedError):
            ids.append(run.launch({**LAUNCH, "launch": place, "aim": aim}).target_id)
    assert ids
    return ids


@pytest.mark.slow
@pytest.mark.parametrize("tracker", ["none", "imm"])
def test_the_scene_of_a_run_with_launches_makes_the_same_events(
    tracker: str, capsys: pytest.CaptureFixture[str]
) -> None:
    run = recorded(loop=False, tracker=tracker)
    ids = launched(run, 3)
    until(lambda: run.state == "ended", within_s=60.0)
    run.stop()
    capsys.readouterr()
    run_command("export events.changes.jsonl --to scene -o recorded.yaml")
    assert capsys.readouterr() == ("recorded.yaml\n", "")
    run_command("run recorded.yaml --quiet")
    events = Path("events.jsonl").read_bytes()
    assert events.count(b"\n") > 100
    targets = yaml.safe_load(Path("recorded.yaml").read_text(encoding="utf-8"))["targets"]
    assert [target["id"] for target in targets] == ["first", *ids]
    assert Path("recorded.events.jsonl").read_bytes() == events


@pytest.mark.slow
def test_the_scene_of_a_later_lap_makes_the_events_of_that_lap() -> None:
    run = recorded(loop=True)
    until(lambda: run.status().lap >= 1, within_s=60.0)
    launched(run, 2)
    lap = run.status().lap
    until(lambda: run.status().lap > lap, within_s=60.0)
    run.stop()
    rows = map(json.loads, Path("events.changes.jsonl").read_text(encoding="utf-8").splitlines())
    lap = max(row["lap"] for row in rows if "launch" in row)
    run_command("export events.changes.jsonl --to scene --set {} -o lap.yaml", f"lap={lap}")
    run_command("run lap.yaml --quiet")
    first = f"2026-04-01T12:{lap:02d}:"
    lines = Path("events.jsonl").read_text(encoding="utf-8").splitlines(keepends=True)
    of_lap = [line for line in lines if first in line]
    assert len(of_lap) > 50
    assert Path("lap.events.jsonl").read_text(encoding="utf-8") == "".join(of_lap)


def changes_file(*rows: Mapping[str, Any]) -> None:
    """Write a file of changes with these rows."""
    path = Path("events.changes.jsonl")
    ChangesFile(path, scene_from_mapping(SCENE), loop=True).end(0)
    head = path.read_text(encoding="utf-8").splitlines()[0]
    path.write_text("\n".join([head, *map(json.dumps, rows), ""]), encoding="utf-8")


def row(lap: int, time_s: float, **change: Any) -> Mapping[str, Any]:
    return {"lap": lap, "time_ns": round(time_s * 1e9), **change}


def test_what_a_scene_cannot_say_is_named(
    capsys: pytest.CaptureFixture[str], caplog: pytest.LogCaptureFixture
) -> None:
    changes_file(
        row(0, 2.0, launch={**LAUNCH, "id": "A", "launch": {**LAUNCH["launch"], "time_s": 2.0}}),
        row(0, 3.0, settings={**SCENE}),
        row(0, 4.0, task={"sensor": "SPOT", "position_ecef_m": None, "track": 7}),
        row(0, 5.0, task={"sensor": "SPOT", "position_ecef_m": [1, 2, 3], "track": -1}),
        row(0, 6.5, task={"sensor": "SPOT", "position_ecef_m": None, "track": -1}),
        row(1, 1.0, launch={**LAUNCH, "id": "B", "launch": {**LAUNCH["launch"], "time_s": 1.0}}),
        {"end_ns": 90_000_000_000},
    )
    run_command("export events.changes.jsonl --to scene")
    assert capsys.readouterr().out == "events.scene.yaml\n"
    expected = [
        "at 3.000 s settings changed",
        "at 4.000 s SPOT was pointed at track 7",
        "at 5.000 s SPOT was pointed at a place",
        "at 6.500 s SPOT was given back to the director",
        "launches of the laps 1: --set lap=1",
    ]
    text = Path("events.scene.yaml").read_text(encoding="utf-8")
    for words in expected:
        assert words in caplog.text
        assert f"# Not in this scene: {words}\n" in text
    assert "the stop" not in text
    assert [target["id"] for target in yaml.safe_load(text)["targets"]] == ["first", "A"]
    run_command("export events.changes.jsonl --to scene --set lap=1")
    text = Path("events.scene.yaml").read_text(encoding="utf-8")
    assert "the stop at 30.000 s; the scene goes on to its end" in text
    assert "settings" not in text


def test_settings_of_earlier_laps_are_those_of_the_lap() -> None:
    changes_file(
        row(0, 3.0, settings={**SCENE, "confidence": "weighted"}),
        row(1, 1.0, launch={**LAUNCH, "id": "B", "launch": {**LAUNCH["launch"], "time_s": 1.0}}),
        row(2, 1.0, settings={**SCENE, "confidence": "paper"}),
    )
    run_command("export events.changes.jsonl --to scene --set lap=1")
    scene = yaml.safe_load(Path("events.scene.yaml").read_text(encoding="utf-8"))
    assert (scene["confidence"], scene["seed"]) == ("weighted", SCENE["seed"] + 1)
    assert scene["epoch"] == "2026-04-01T12:01:00Z"


def test_a_killed_run_says_so(caplog: pytest.LogCaptureFixture) -> None:
    changes_file()
    run_command("export events.changes.jsonl --to scene")
    assert "the kill of the run; the scene goes on to its end" in caplog.text


def test_a_damaged_scene_is_refused_with_its_file(capsys: pytest.CaptureFixture[str]) -> None:
    changes_file()
    text = Path("events.changes.jsonl").read_text(encoding="utf-8")
    Path("events.changes.jsonl").write_text(text.replace('"epoch"', '"epoc"'), encoding="utf-8")
    assert main(["export", "events.changes.jsonl", "--to", "scene"]) == 2
    expected = "events.changes.jsonl: 1 problem\n  scene: lacks or has damaged settings: 'epoch'"
    assert expected in capsys.readouterr().err


def test_other_formats_name_the_way(capsys: pytest.CaptureFixture[str]) -> None:
    changes_file()
    assert main(["export", "events.changes.jsonl", "--to", "csv"]) == 2
    told = capsys.readouterr().err
    assert "opir run events.changes.jsonl -o again.jsonl" in told
    assert "--to scene" in told


def test_the_scene_of_a_saved_run_makes_the_same_events() -> None:
    run_command("run {} --set duration_s=40 --out one.jsonl --quiet", EXAMPLES / "first_light.yaml")
    run_command("export one.jsonl --to scene -o again.yaml")
    run_command("run again.yaml --quiet")
    assert Path("again.events.jsonl").read_bytes() == Path("one.jsonl").read_bytes()
