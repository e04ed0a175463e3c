"""`opir explain` lists the rates that a tracker assumes beside what the scene has."""

import pytest

import opir_core as opir
from opir_core.cli.main import main
from opir_core.simulation.explanation import explained

SCENE = "examples/busy_sky.yaml"
DAYS = 60.0 / 86_400.0


def rates(*changes: str) -> dict[str, dict[str, object]]:
    plan = opir.compile_plan(opir.load_scene(SCENE, overrides=["outputs=[]", *changes]))
    return {row["what"]: row for row in explained(plan)["rates"]}


def test_rates_stand_beside_what_the_scene_has() -> None:
    rows = rates("sources[9].at=[{lat_deg: -8, lon_deg: 27}, {lat_deg: 9, lon_deg: 27}]")
    assert rows["launches_per_day"]["scene"] == {"launch": 1}
    assert rows["launches_per_day"]["per_day"] == 1.0
    assert rows["launches_per_day"]["in_duration"] == pytest.approx(DAYS)
    assert "notional" in str(rows["launches_per_day"]["source"])
    assert rows["ground_sources_per_day"]["scene"] == {"fire": 25, "fire front": 2}
    assert "MODIS" in str(rows["ground_sources_per_day"]["source"])
    assert rows["others_per_day"]["scene"] == {}


def test_what_no_other_rate_is_of_is_among_the_others() -> None:
    ship = "{id: ship, model: ships, at: [{lat_deg: 5, lon_deg: 60, heading_deg: 0}]}"
    rows = rates(f"sources=[{ship}]")
    assert rows["others_per_day"]["scene"] == {"ship": 1}
    assert all(not row["scene"] for name, row in rows.items() if name[:2] not in ("ot", "la"))


def test_the_source_of_a_rate_that_the_scene_sets_is_the_scene() -> None:
    row = rates("tracker.hypotheses.flashes_per_day=5000.0")["flashes_per_day"]
    assert (row["per_day"], row["source"]) == (5000.0, "set by the scene")


def test_the_source_names_what_a_rate_is_within_areas() -> None:
    area = "{south_deg: 1, north_deg: 9, west_deg: 1, east_deg: 9, rates: {flashes_per_day: 500}}"
    rows = rates(f"tracker.hypotheses.areas=[{area}]")
    assert str(rows["flashes_per_day"]["source"]).endswith("notional; within areas[0]: 500")
    assert "within" not in str(rows["bolides_per_day"]["source"])


def test_a_scene_without_a_tracker_has_no_rates(capsys: pytest.CaptureFixture[str]) -> None:
    assert rates("tracker=none") == {}
    assert main(["explain", SCENE, "--tracker", "none"]) == 0
    assert "assumes in view" not in capsys.readouterr().out


def test_the_text_has_a_line_for_each_rate(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["explain", SCENE]) == 0
    lines = capsys.readouterr().out.splitlines()
    start = next(place for place, line in enumerate(lines) if "assumes in view" in line)
    (line,) = (line for line in lines[start:] if line.startswith("flashes_per_day"))
    assert line.split()[:4] == ["flashes_per_day", "7.5", "0.0052", "1"]
    assert " 1 404 lightning " in line
