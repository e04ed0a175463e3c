"""Who was sent where and why: the report's spans against the commands of a run."""

from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from figure_rules import drawn_complaints
from opir_report.pages.page import ReportTable
from reported_runs import report_data, report_page, scored_run

import opir_core as opir
from opir_core.plugin import CommandRecord

SCENE: dict[str, Any] = {
    "scene": "directed",
    "epoch": "2026-04-01T12:00:00Z",
    "duration_s": 90.0,
    "seed": 3,
    "sensors": [
        {"model": "generic-scanner", "id": "WIDE", "orbital_slot_deg": -150.0},
        {"model": "generic-pointed", "id": "SPOT", "orbital_slot_deg": -100.0},
    ],
    "targets": [
        {
            "id": "T1",
            "type": "ICBM",
            "launch": {"lat_deg": 34.0, "lon_deg": -120.0, "time_s": 0.0},
            "aim": {"lat_deg": 9.0, "lon_deg": 167.7},
        }
    ],
    "director": {"model": "round-robin", "places_deg": [[34, -120], [10, -90]], "dwell_s": 30},
}


@cache
def directed_run() -> opir.Run:
    return opir.simulate(opir.scene_from_mapping(SCENE))


def test_spans_are_those_of_the_accepted_commands() -> None:
    spans = report_data(directed_run())["directing"]
    records = directed_run().commands
    assert [record.time_s for record in records] == [0.0, 30.0, 60.0]
    assert spans.reason.tolist() == [record.reason for record in records]
    assert spans.from_s.tolist() == [record.from_s for record in records]
    assert spans.until_s.tolist() == [*(record.start_s for record in records[1:]), 90.0]
    assert set(spans.sensor_id) == {"SPOT"}
    assert set(spans.target_id) == {""}


def test_commands_that_follow_one_track_are_one_span() -> None:
    refusal = "out of its field of regard"
    records = [
        CommandRecord(10.0, "SPOT", 4, "track 4 since 10 s", 11.0, 15.0),
        CommandRecord(20.0, "SPOT", 4, "track 4 since 10 s", 21.0, 21.0),
        CommandRecord(30.0, "SPOT", 5, "track 5", float("nan"), float("nan"), refusal),
        CommandRecord(40.0, "SPOT", 6, "track 6", 41.0, 44.0),
    ]
    run = opir.simulate(opir.scene_from_mapping(SCENE))
    object.__setattr__(run, "commands", records)
    spans = report_data(run)["directing"]
    assert spans.commands.tolist() == [2, 1]
    assert spans.start_s.tolist() == [11.0, 41.0]
    assert spans.until_s.tolist() == [41.0, 90.0]
    (section,) = [each for each in report_page(run).sections if each.name == "directing"]
    tables = {each.caption: each.rows for each in section.parts if isinstance(each, ReportTable)}
    assert [list(row) for row in tables["Refused commands"]] == [["SPOT", refusal, "1"]]
    assert len(tables["Who was sent where, and why"]) == 2


def test_a_run_without_a_director_has_no_such_section() -> None:
    assert "directing" not in [section.name for section in report_page(scored_run()).sections]
    axes = scored_run().plot.directing()
    assert "no narrow field" in axes.texts[0].get_text()


@pytest.mark.parametrize("ending", ["jsonl", "parquet"])
def test_commands_are_read_back(tmp_path: Path, ending: str) -> None:
    path = directed_run().save(tmp_path / f"events.{ending}")
    assert opir.load_run(path).commands == directed_run().commands
    assert opir.load_run(tmp_path).commands == directed_run().commands


def test_commands_of_another_run_are_refused(tmp_path: Path) -> None:
    path = directed_run().save(tmp_path / "events.jsonl")
    commands = tmp_path / "events.commands.jsonl"
    commands.write_text(commands.read_text().replace("turn", "order"))
    with pytest.raises(opir.OpirError, match="not the commands of the manifest's run"):
        opir.load_run(path)


MODES = {"wide": {"half_angle_deg": 4.0}, "stare": {"settle_s": 5.0}}
MODED: dict[str, Any] = {
    **SCENE,
    "sensors": [SCENE["sensors"][0], {**SCENE["sensors"][1], "modes": MODES}],
    "director": {**SCENE["director"], "mode": "stare"},
}


@cache
def moded_run() -> opir.Run:
    """Return a run whose sensor is sent in three modes: the last two commands follow one track."""
    run = opir.simulate(opir.scene_from_mapping(MODED))
    wide = CommandRecord(5.0, "SPOT", -1, "too long for its bar", 6.0, 9.0, mode="wide")
    refused = CommandRecord(10.0, "SPOT", -1, "no", float("nan"), float("nan"), "no", mode="stare")
    follows = CommandRecord(20.0, "SPOT", 4, "track 4: 1.5 nats", 21.0, 30.0, mode="stare")
    again = CommandRecord(40.0, "SPOT", 4, "track 4: 0.5 nats", 41.0, 44.0)
    object.__setattr__(run, "commands", [wide, refused, follows, again])
    return run


def test_the_modes_of_a_sensor_over_time_are_those_of_its_commands() -> None:
    rows = report_data(moded_run())["modes"]
    assert [tuple(row) for row in rows] == [
        ("SPOT", "own settings", 1.0, -1, "", "", 0.0, 0.0, 6.0, 6.0),
        ("SPOT", "wide", 4.0, -1, "", "too long for its bar", 6.0, 9.0, 21.0, 12.0),
        ("SPOT", "stare", 1.0, 4, "", "track 4: 1.5 nats", 21.0, 30.0, 90.0, 57.0),
    ]


def test_the_strip_of_modes_has_their_names_and_reasons() -> None:
    axes = moded_run().plot.modes()
    assert [text.get_text() for text in axes.get_legend().get_texts()] == [
        "own settings",
        "wide",
        "stare",
    ]
    (text,) = axes.texts
    assert (text.get_text(), text.get_position()[0]) == ("track 4: 1.5 nats", 60.0)
    (section,) = [each for each in report_page(moded_run()).sections if each.name == "directing"]
    pictures = [each for each in section.parts if not isinstance(each, ReportTable)]
    assert [each.name for each in pictures] == ["directing", "modes"]
    assert drawn_complaints(pictures[1]) == []
    (table,) = [each for each in section.parts if getattr(each, "caption", "") == "Modes"]
    assert table.rows[1:] == [("SPOT", "wide", "4", "12.0"), ("SPOT", "stare", "1", "57.0")]


def test_a_sensor_that_is_down_looks_nowhere() -> None:
    down = [{"sensor": "SPOT", "fault": "down", "at_s": 40, "until_s": 60}]
    run = opir.simulate(opir.scene_from_mapping({**MODED, "faults": down}))
    object.__setattr__(run, "commands", moded_run().commands)
    *_, follows = report_data(run)["modes"]
    assert tuple(follows)[-3:] == (30.0, 90.0, 40.0)
    for axes in (run.plot.modes(), run.plot.directing()):
        edges_s = {
            round(float(edge), 6)
            for bars in axes.collections
            for path in bars.get_paths()
            for edge in (path.vertices[:, 0].min(), path.vertices[:, 0].max())
        }
        assert {40.0, 60.0} <= edges_s


def test_a_wide_field_in_survey_is_its_field_of_regard() -> None:
    wide = {"model": "SBIRS-GEO", "id": "STARER", "orbital_slot_deg": -100, "modes": "notional"}
    places = {"places_deg": [[34, -120]], "mode": "survey", "dwell_s": 60}
    scene = {**MODED, "sensors": [wide], "director": {**SCENE["director"], **places}}
    rows = report_data(opir.simulate(opir.scene_from_mapping(scene)))["modes"]
    assert set(rows["half_angle_deg"]) == {10.0}


def ground_km2(latitude_deg: float, half_angle_deg: float) -> float:
    """Return the ground of a sphere in a field of a geostationary sensor that looks at a latitude
    of its meridian, by a grid.
    """
    step = np.radians(0.1)
    latitude, longitude = np.meshgrid(
        np.arange(-0.5 * np.pi, 0.5 * np.pi, step) + 0.5 * step,
        np.arange(-0.5 * np.pi, 0.5 * np.pi, step) + 0.5 * step,
    )
    flat = np.cos(latitude)
    up = np.stack([flat * np.cos(longitude), flat * np.sin(longitude), np.sin(latitude)], axis=-1)
    sensor_km = np.array([42_164.0, 0.0, 0.0])
    angle = np.radians(latitude_deg)
    axis = 6371.0 * np.array([np.cos(angle), 0.0, np.sin(angle)]) - sensor_km
    sight = 6371.0 * up - sensor_km
    lengths = np.linalg.norm(sight, axis=-1)
    is_inside = sight @ axis >= np.cos(np.radians(half_angle_deg)) * lengths * np.linalg.norm(axis)
    is_above = np.einsum("ijk,ijk->ij", sight, up) < 0.0
    return float((flat * (is_inside & is_above)).sum() * (6371.0 * step) ** 2)


def test_a_footprint_is_the_ground_in_the_field_as_far_as_the_limb() -> None:
    """At 60 deg north a field of 2 deg reaches over the limb."""
    spot = {**SCENE["sensors"][1], "pointing": {"half_angle_deg": 2.0}}
    director = {**SCENE["director"], "places_deg": [[60, -100], [0, -100]]}
    sensors = [SCENE["sensors"][0], spot]
    run = opir.simulate(
        opir.scene_from_mapping({**SCENE, "sensors": sensors, "director": director})
    )
    rows = report_data(run)["footprints"]
    assert rows.half_angle_deg.tolist() == pytest.approx([2.0, 2.0, 2.0])
    np.testing.assert_allclose(rows.latitude_deg, [60.0, 60.0, 0.0], atol=1e-9)
    np.testing.assert_allclose(rows.longitude_deg, -100.0, atol=1e-9)
    wanted_km2 = [ground_km2(latitude, 2.0) for latitude in (60.0, 60.0, 0.0)]
    np.testing.assert_allclose(rows.ground_km2, wanted_km2, rtol=0.005)
    labels = [text.get_text() for text in run.plot.footprints().texts]
    assert [label for label in labels if "SPOT" in label] == [
        f"SPOT from {rows.from_s[row]:.0f} s" for row in (0, 2)
    ]


def test_fields_that_look_over_the_ground_have_no_map() -> None:
    run = opir.simulate(opir.scene_from_mapping(SCENE))
    high = [record._replace(position_ecef_m=(0.0, 0.0, 9e6)) for record in run.commands]
    object.__setattr__(run, "commands", high)
    assert "footprints" not in report_data(run)
    assert "no narrow field" in run.plot.footprints().texts[0].get_text()


def test_modes_that_no_command_names_have_no_picture() -> None:
    assert "modes" not in report_data(directed_run())
    unnamed = {**MODED, "director": SCENE["director"]}
    run = opir.simulate(opir.scene_from_mapping(unnamed))
    assert "modes" not in report_data(run)
    assert "no command named a mode" in run.plot.modes().texts[0].get_text()


def test_looks_of_a_sensor_with_modes_are_not_those_of_its_own_settings() -> None:
    spot = {**SCENE["sensors"][1], "modes": {"stare": {}}}
    scene = {**SCENE, "sensors": [SCENE["sensors"][0], spot]}
    page = report_page(opir.simulate(opir.scene_from_mapping(scene)))
    (table,) = [
        each
        for section in page.sections
        for each in section.parts
        if isinstance(each, ReportTable) and each.caption == "Sensors"
    ]
    assert [row[2] == "–" for row in table.rows] == [False, True]
