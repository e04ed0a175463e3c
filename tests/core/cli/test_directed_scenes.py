"""What `opir explain` and `opir run` say of sensors that a director points."""

import json
from pathlib import Path
from typing import Any

import pytest

from opir_core.builtin.directors import RoundRobin
from opir_core.cli.main import main
from opir_core.plugin import Command

SCENE = """
scene: directed
epoch: "2026-04-01T12:00:00Z"
duration_s: 60
seed: 5
sensors:
  - model: generic-pointed
    id: SPOT
    orbital_slot_deg: -100.0
    modes: {sector: {half_angle_deg: 3.0}, stare: {settle_s: 4.0}}
targets:
  - id: T1
    type: ICBM
    launch: {lat_deg: 34.73, lon_deg: -120.57, time_s: 1.0}
    aim: {lat_deg: 9.0, lon_deg: 167.7}
director: {model: round-robin, places_deg: [[34.73, -120.57]], mode: stare}
outputs: ["null"]
"""


@pytest.fixture
def path(tmp_path: Path) -> str:
    scene = tmp_path / "scene.yaml"
    scene.write_text(SCENE)
    return str(scene)


def test_explain_lists_the_modes(path: str, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["explain", path]) == 0
    assert "modes that a command may name\nSPOT: sector, stare\n" in capsys.readouterr().out


def test_run_counts_the_commands_that_sensors_refuse(
    path: str,
    tmp_path: Path,
    capsys: pytest.CaptureFixture[str],
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    assert main(["run", path]) == 0
    assert "refused" not in capsys.readouterr().out
    unknown = [Command(sensor="SPOT", mode="star")]
    monkeypatch.setattr(RoundRobin, "commands", lambda *_: unknown)
    assert main(["run", path]) == 0
    assert "director: 3 of 3 commands refused\n" in capsys.readouterr().out
    assert main(["run", path, "-o", str(tmp_path / "e.jsonl")]) == 0
    written = tmp_path / "e.commands.jsonl"
    assert f"3 of 3 commands refused; {written} says why\n" in capsys.readouterr().out
    assert [row["refusal"] for row in lines_of(written)] == [
        "SPOT has no mode 'star'; the nearest: stare, sector"
    ] * 3


def test_a_mode_that_no_sensor_has_is_refused_with_its_place(
    path: str, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["run", path, "--set", "director.mode=star"]) != 0
    assert "director.mode: no sensor has the mode 'star'; the nearest is 'stare'" in (
        capsys.readouterr().err
    )


def lines_of(path: Path) -> list[Any]:
    return [json.loads(line) for line in path.read_text(encoding="utf-8").splitlines()]


def require_commands(path: Path) -> None:
    """Fail if a file has not the three commands of the scene, the turn of one degree a second in
    the first.
    """
    first, *others = lines_of(path)
    names = "time_s", "sensor_id", "track_id", "reason", "start_s", "from_s", "refusal", "mode"
    assert tuple(first) == (*names, "position_ecef_m")
    assert (first["sensor_id"], first["track_id"], first["mode"]) == ("SPOT", None, "stare")
    assert (first["reason"], first["refusal"]) == ("place 1 in turn", "")
    assert first["from_s"] > first["start_s"] + 4.0
    assert [row["time_s"] for row in (first, *others)] == [0.0, 20.0, 40.0]
    assert all(row["from_s"] == row["start_s"] > row["time_s"] for row in others)


def test_run_writes_commands_beside_the_events(path: str, tmp_path: Path) -> None:
    assert main(["run", path, "-q", "-o", str(tmp_path / "e.jsonl")]) == 0
    written = tmp_path / "e.commands.jsonl"
    require_commands(written)
    files = json.loads((tmp_path / "e.manifest.json").read_text())["written_files"]
    assert [entry["name"] for entry in files if entry["kind"] == "commands"] == [written.name]


def test_run_writes_commands_where_it_is_told(
    path: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    elsewhere = tmp_path / "elsewhere.jsonl"
    options = ["-o", str(tmp_path / "e.jsonl"), "--commands", str(elsewhere), "--json"]
    assert main(["run", path, *options]) == 0
    require_commands(elsewhere)
    assert not (tmp_path / "e.commands.jsonl").exists()
    assert json.loads(capsys.readouterr().out)["files"]["commands"] == str(elsewhere)


def test_commands_do_not_overwrite_the_events(
    path: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    events = str(tmp_path / "e.jsonl")
    assert main(["run", path, "-o", events, "--commands", events]) != 0
    assert "the commands would overwrite" in capsys.readouterr().err


@pytest.mark.parametrize("options", [[], ["--commands", "c.jsonl"]])
def test_a_scene_without_a_director_has_no_commands(
    path: str, tmp_path: Path, capsys: pytest.CaptureFixture[str], options: list[str]
) -> None:
    words = ["run", path, "--set", "director=none", "-o", str(tmp_path / "e.jsonl"), *options]
    assert (main(words) == 0) == (not options)
    assert not (tmp_path / "e.commands.jsonl").exists()
    assert ("--commands: the scene has no director" in capsys.readouterr().err) == bool(options)
