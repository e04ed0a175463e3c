"""Scenes that name a file of elements: which of its satellites are sensors, and what is refused."""

import json
from pathlib import Path

import numpy as np
import pytest
from satellite_elements import OMM, OTHER, TLE, omm_texts

from opir_core import compile_plan, scene_from_mapping
from opir_core.errors import SceneError
from opir_core.plugin import Host
from opir_core.reading import scene_mapping

SCENE = {"scene": "fleet", "epoch": "2026-04-01T12:00:00Z", "duration_s": 300}


@pytest.fixture(autouse=True)
def folder(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    Path("fleet.tle").write_text(TLE)


def scene(fleet, **more):
    return scene_from_mapping({**SCENE, "sensors": [{"model": "LEO-WIDE", "fleet": fleet, **more}]})


@pytest.mark.parametrize(
    ("filters", "ids"),
    [
        ({}, ["ISS-ZARYA", "TWO"]),
        ({"name": "iss*"}, ["ISS-ZARYA"]),
        ({"min_inclination_deg": 90}, ["TWO"]),
        ({"max_inclination_deg": 90}, ["ISS-ZARYA"]),
        ({"numbers": "1,25545:25600"}, ["TWO"]),
        ({"max_age_days": 14}, ["ISS-ZARYA"]),
    ],
)
def test_a_fleet_is_filtered(filters, ids):
    assert [sensor.id for sensor in scene({"file": "fleet.tle", **filters}).sensors] == ids


RING = {"count": 4, "first_deg": 10.0, "spacing_deg": 20.0}
PATTERN = {"planes": 3, "phasing": 1, "altitude_km": 1200.0, "inclination_deg": 60.0}


@pytest.mark.parametrize(
    ("fleet", "ids"),
    [
        ({"walker": {**PATTERN, "total": 6}}, [f"WALKER-{number}" for number in range(1, 7)]),
        (
            {"walker": {**PATTERN, "per_plane": 4, "prefix": "W"}, "numbers": "11:12"},
            ["W-11", "W-12"],
        ),
        ({"walker": {**PATTERN, "total": 12}, "name": "*-0[12]"}, ["WALKER-01", "WALKER-02"]),
        ({"slots": RING}, ["GEO-1", "GEO-2", "GEO-3", "GEO-4"]),
        (
            {"slots": {**RING, "prefix": "SLOT"}, "numbers": "2", "max_inclination_deg": 1},
            ["SLOT-2"],
        ),
    ],
)
def test_a_pattern_gives_each_satellite_an_id_and_is_filtered(fleet, ids):
    assert [sensor.id for sensor in scene(fleet).sensors] == ids


@pytest.mark.parametrize(
    ("fleet", "reason"),
    [
        (
            {"walker": {**PATTERN, "total": 7}},
            "fleet.walker: 7 satellites cannot be shared evenly among 3 planes",
        ),
        ({"walker": PATTERN}, "fleet.walker: give total or per_plane"),
        (
            {"walker": {**PATTERN, "total": 6, "period_min": 100}},
            "altitude_km and period_min exclude each other",
        ),
        (
            {"walker": {**PATTERN, "total": 6, "raan_deg": 1, "lon_asc_node_deg": 1}},
            "raan_deg and lon_asc_node_deg exclude each other",
        ),
        (
            {"walker": {**PATTERN, "total": 6, "altitude_km": None, "period_min": 80}},
            "an orbit inside the Earth",
        ),
        (
            {"slots": RING, "min_inclination_deg": 1},
            "no satellite is left of 4; left out 4 by inclination",
        ),
        (
            {"slots": RING, "file": "fleet.tle"},
            "sensors[0].fleet: file and slots exclude each other",
        ),
        ({"slots": {**RING, "count": 0}}, "sensors[0].fleet.slots.count: 0"),
    ],
)
def test_an_impossible_pattern_is_refused_with_its_place(fleet, reason):
    with pytest.raises(SceneError) as refused:
        scene(fleet)
    assert reason in str(refused.value)


def test_two_patterns_in_one_scene_need_prefixes():
    ring = {"model": "LEO-WIDE", "fleet": {"slots": RING}}
    with pytest.raises(SceneError, match="GEO-1"):
        scene_from_mapping({**SCENE, "sensors": [ring, ring]})
    prefixed = {"model": "LEO-WIDE", "fleet": {"slots": {**RING, "prefix": "B"}}}
    assert len(scene_from_mapping({**SCENE, "sensors": [ring, prefixed]}).sensors) == 8


@pytest.mark.parametrize("form", ["json", "csv", "kvn", "xml"])
def test_satellites_of_each_form_fly_as_by_their_own_elements(form):
    Path("fleet").write_text(omm_texts([OMM, OTHER])[form])
    plan = compile_plan(scene({"file": "fleet"}, scan_period_ms=500))
    single = compile_plan(scene_from_mapping({**SCENE, "sensors": singles(OMM, OTHER)}))
    time_s = np.array([0.0, 200.0])
    for sensor, expected in zip(plan.sensors, single.sensors, strict=True):
        np.testing.assert_array_equal(
            sensor.orbit.position_ecef_m(time_s), expected.orbit.position_ecef_m(time_s)
        )
        assert sensor.scan.period_ns == 500_000_000


def singles(*rows):
    return [
        {"model": "LEO-WIDE", "id": f"S{k}", "orbit": {"omm": row}} for k, row in enumerate(rows)
    ]


def test_a_scene_with_a_fleet_is_written_without_its_file():
    loaded = scene({"file": "fleet.tle"})
    written = json.loads(json.dumps(scene_mapping(loaded)))
    Path("fleet.tle").unlink()
    assert scene_from_mapping(written).sensors[1].model.config == loaded.sensors[1].model.config


@pytest.mark.parametrize(
    ("fleet", "more", "reported"),
    [
        ({}, {}, "sensors[0].fleet: give file, walker or slots"),
        ({"file": "no.tle"}, {}, "sensors[0].fleet: no.tle: cannot be read"),
        ({"file": "fleet.tle", "name": "x*"}, {}, "no satellite is left of 2; left out 2 by name"),
        (
            {"file": "fleet.tle", "numbers": "a"},
            {},
            "sensors[0].fleet.numbers: 'a' are no catalogue numbers",
        ),
        ({"file": "fleet.tle"}, {"id": "A"}, "sensors[0].id: a fleet brings the id of its sensors"),
        (
            {"file": "fleet.tle"},
            {"orbit": {}},
            "sensors[0].orbit: a fleet brings the orbit of its sensors",
        ),
        ({"file": "fleet.tle"}, {"scan_period_ms": -1}, "sensors[0].scan_period_ms: -1"),
    ],
)
def test_what_is_wrong_is_refused_with_its_place(fleet, more, reported):
    with pytest.raises(SceneError) as refused:
        scene(fleet, **more)
    assert reported in str(refused.value)


@pytest.mark.parametrize("broken", [json.dumps([OMM, {**OTHER, "BSTAR": None}]), TLE[:-2] + "x\n"])
def test_wrong_elements_are_refused_unless_filtered_out(broken):
    Path("fleet").write_text(broken)
    with pytest.raises(
        SceneError, match=r"fleet: the elements of TWO: .*; mend them, or leave them out by name"
    ):
        scene({"file": "fleet"})
    assert [sensor.id for sensor in scene({"file": "fleet", "name": "ISS*"}).sensors] == [
        "ISS-ZARYA"
    ]


def test_of_one_number_the_latest_elements_count():
    Path("fleet.json").write_text(json.dumps([OTHER, {**OTHER, "EPOCH": "2026-03-31T00:00:00"}]))
    (sensor,) = scene({"file": "fleet.json"}).sensors
    assert sensor.model.config.orbit.omm["EPOCH"] == "2026-03-31T00:00:00"


def test_a_wrong_epoch_is_the_only_error():
    with pytest.raises(SceneError) as refused:
        scene_from_mapping(
            {
                **SCENE,
                "epoch": "x",
                "sensors": [
                    {"model": "LEO-WIDE", "fleet": {"file": "fleet.tle", "max_age_days": 1}}
                ],
            }
        )
    assert [problem.path for problem in refused.value.problems] == ["epoch"]


def test_without_a_reader_of_fleets_the_remedy_is_given():
    sensors = [{"model": "SCANNER", "fleet": {"file": "fleet.tle"}}]
    with pytest.raises(
        SceneError,
        match=r"sensors\[0\].fleet: no installed plugin reads fleets .* install \./plugins/opir_readers",
    ):
        scene_from_mapping({**SCENE, "sensors": sensors}, host=Host.of())
