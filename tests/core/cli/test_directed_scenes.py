"""What `opir explain` and `opir run` say of sensors that a director points."""

from pathlib import Path

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
    path: str, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    assert main(["run", path]) == 0
    assert "refused" not in capsys.readouterr().out
    unknown = [Command(sensor="SPOT", mode="star")]
    monkeypatch.setattr(RoundRobin, "commands", lambda *_: unknown)
    assert main(["run", path]) == 0
    assert "director: 3 of 3 commands refused" in capsys.readouterr().out


def test_a_mode_that_no_sensor_has_is_refused_with_its_place(
    path: str, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["run", path, "--set", "director.mode=star"]) != 0
    assert "director.mode: no sensor has the mode 'star'; the nearest is 'stare'" in (
        capsys.readouterr().err
    )
