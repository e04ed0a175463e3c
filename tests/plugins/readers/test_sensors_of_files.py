"""Sensors in orbits from files: elements of any form, ephemerides, opir's own exports, and whole
fleets.
"""

import json
import math
from functools import partial
from pathlib import Path

import numpy as np
import pytest
from command_line import main, run_command
from read_files import EPOCH_US, READER, READERS, read, recognised, refusal
from satellite_elements import LINES, OMM, OTHER, TLE, omm_texts

from opir_core import compile_plan, scene_from_mapping, simulate
from opir_core.errors import PluginError, SceneError
from opir_core.orbits import OmmFileConfig, OrbitConfig, orbit_of
from opir_core.orbits.configs import OrbitFileConfig
from opir_core.plugin import BadFileError, Host


def orbit_of_file(path, satellite):
    block = OrbitFileConfig(path=str(path), satellite=satellite)
    return READER["omm"].orbit(block, EPOCH_US, READERS)


@pytest.mark.parametrize("form", ["json", "csv", "kvn", "xml"])
@pytest.mark.parametrize("satellite", ["ISS (ZARYA)", "iss (zarya)", "25544", "1998-067A"])
def test_elements_of_each_form_are_the_same_orbit(tmp_path, form, satellite):
    rows = [OMM, {**OTHER, "OBJECT_ID": "1958-002B"}]
    text = omm_texts(rows)[form]
    assert recognised(text) == ["omm"]
    assert [elements["NORAD_CAT_ID"] for elements in read("omm", text)] == [25544, 5]
    (tmp_path / "f").write_text(text)
    time_s = np.linspace(0.0, 3000.0, 7)
    position = orbit_of_file(tmp_path / "f", satellite).position_ecef_m(time_s)
    expected = orbit_of(OrbitConfig(omm=OMM), EPOCH_US).position_ecef_m(time_s)
    np.testing.assert_allclose(position, expected, rtol=0.0, atol=1e-6)


def test_two_line_elements_are_the_orbit_of_their_lines(tmp_path):
    (tmp_path / "f.tle").write_text(TLE)
    orbit = orbit_of_file(tmp_path / "f.tle", "25544")
    time_s = np.linspace(0.0, 3000.0, 7)
    expected = orbit_of(OrbitConfig(tle=LINES), EPOCH_US).position_ecef_m(time_s)
    np.testing.assert_allclose(orbit.position_ecef_m(time_s), expected, rtol=0.0, atol=1e-9)
    with pytest.raises(BadFileError, match="has 2 satellites; say which with satellite: ISS"):
        orbit_of_file(tmp_path / "f.tle", None)
    with pytest.raises(BadFileError, match="has no satellite 'ISS' among 2; did you mean ISS"):
        orbit_of_file(tmp_path / "f.tle", "ISS")


def test_lines_of_68_columns_and_with_a_tail_are_noted():
    text = f"{LINES[0][:68]}\n{LINES[1]} EXTRA\n"
    (row,) = read("tle", text)
    assert (row["TLE_LINE1"], row["TLE_LINE2"]) == LINES
    assert row["NOTES"] == [
        "line 1 has 68 columns: its checksum was added",
        "line 2: 'EXTRA' after column 69 is left out",
    ]
    assert row["EPOCH"] == "2026-04-01T12:00:00"
    assert "NOTES" not in read("tle", TLE)[0]


def test_a_broken_set_does_not_cost_the_others():
    broken = TLE.replace("97.6416", "97.6417")
    assert [("PROBLEM" in row) for row in read("tle", broken)] == [False, True]
    reason = refusal("tle", "\n".join(LINES).replace("51.6416", "51.6417"))
    assert "lines 1 and 2: line 2 has the checksum 7, and its digits come to" in reason
    reason = refusal("tle", LINES[0])
    assert "line 1: the first line of elements has no second one" in reason


@pytest.mark.parametrize(
    ("text", "number"),
    [("A0001", 100_001), ("Z9999", 339_999), ("00005", 5), (5, 5), ("I0000", "I0000")],
)
def test_numbers_are_numbers(text, number):
    (elements,) = read("omm", json.dumps([{**OMM, "NORAD_CAT_ID": text}]))
    assert elements["NORAD_CAT_ID"] == number


@pytest.fixture
def fleet(imported):
    Path("fleet.tle").write_text(TLE)
    return partial(imported, "fleet.tle")


@pytest.mark.parametrize(
    ("words", "names", "reported"),
    [
        ([], ["ISS-ZARYA", "TWO"], "2 sets of elements\n"),
        (["--name", "iss*"], ["ISS-ZARYA"], "left out 1 by name"),
        (["--inclination", "90:100"], ["TWO"], "left out 1 by inclination"),
        (["--inclination", "0:60"], ["ISS-ZARYA"], "left out 1 by inclination"),
        (["--numbers", "25544"], ["ISS-ZARYA"], "left out 1 by number"),
        (["--numbers", "1,25545:25600"], ["TWO"], "left out 1 by number"),
        (
            ["--max-age-days", "14", "--epoch", "2026-04-01T12:00:00Z"],
            ["ISS-ZARYA"],
            "left out 1 by age",
        ),
    ],
)
def test_a_fleet_is_filtered_and_flies(fleet, words, names, reported):
    out = fleet("--sensors", "LEO-WIDE", "--out", "fleet.yaml", *words)
    assert reported in out
    scene = (
        "scene: fleet\nepoch: '2026-04-01T12:00:00Z'\nduration_s: 10\n"
        + Path("fleet.yaml").read_text()
    )
    Path("scene.yaml").write_text(scene)
    run_command("validate scene.yaml")
    assert [
        line.split('"id": "')[1].split('"')[0] for line in scene.splitlines() if '"id"' in line
    ] == names


@pytest.mark.parametrize(
    ("words", "reported"),
    [
        (["--inclination", "x"], "--inclination"),
        (["--max-age-days", "3"], "needs the scene's epoch"),
        (["--epoch", "x"], "--epoch"),
    ],
)
def test_what_is_no_filter_is_reported(fleet, words, reported):
    assert reported in fleet(*words, code=2)


SCENE = {
    "scene": "own",
    "epoch": "2026-04-01T12:00:00Z",
    "duration_s": 300,
    "seed": 3,
    "targets": [
        {
            "id": "T1",
            "type": "ICBM",
            "launch": {"lat_deg": 34.73, "lon_deg": -120.57, "time_s": 10},
            "aim": {"lat_deg": 9, "lon_deg": 167.7},
        }
    ],
}
ORBIT = {
    "circular": {
        "altitude_km": 1200.0,
        "inclination_deg": 60.0,
        "lon_asc_node_deg": 260.0,
        "arg_latitude_deg": 40.0,
    }
}


def test_an_export_of_sensors_flies_as_sensors(tmp_path):
    block = {"model": "LEO-WIDE", "id": "L1", "scan_period_ms": 1000}
    scene = {
        **SCENE,
        "sensors": [{**block, "orbit": ORBIT}],
        "outputs": [{"jsonl": {"path": str(tmp_path / "e.jsonl")}}],
    }
    (tmp_path / "s.yaml").write_text(json.dumps(scene))
    run_command("run {} -q", tmp_path / "s.yaml")
    words = ["--to", "oem", "--set", "objects=sensors", "--set", "step_s=30", "--out"]
    assert main(["export", str(tmp_path / "e.jsonl"), *words, str(tmp_path / "oem")]) == 0
    file = {"file": {"path": str(tmp_path / "oem" / "sensor-L1.oem")}}
    flown, exact = (
        simulate(scene_from_mapping({**SCENE, "sensors": [{**block, "orbit": orbit}]})).detections
        for orbit in (file, ORBIT)
    )
    assert len(flown) > 50
    np.testing.assert_array_equal(flown.time_ns, exact.time_ns)
    # States of 30 s with velocities: the interpolation is a hundredth of a metre at most.
    np.testing.assert_allclose(flown.sensor_ecef_m, exact.sensor_ecef_m, rtol=0.0, atol=0.01)
    sight = flown.line_of_sight_ecef - exact.line_of_sight_ecef
    assert np.abs(sight).max() <= 1e-7


def test_an_ephemeris_that_does_not_cover_the_scene_is_reported(tmp_path):
    (tmp_path / "o.oem").write_text(READER["oem"].example)
    sensor = {"model": "LEO-WIDE", "id": "L1", "orbit": {"file": {"path": str(tmp_path / "o.oem")}}}
    late = {**SCENE, "epoch": "2026-04-02T12:00:00Z", "sensors": [sensor]}
    with pytest.raises(
        SceneError, match="has no state at 2026-04-02T12:00:00Z: its states go from 2026-04-01"
    ) as refused:
        compile_plan(scene_from_mapping(late))
    assert "sensors[0].orbit.file.path" in str(refused.value)
    missing = {**sensor, "orbit": {"file": {"path": str(tmp_path / "none.oem")}}}
    with pytest.raises(SceneError, match="cannot be read: no such file"):
        compile_plan(scene_from_mapping({**SCENE, "sensors": [missing]}))


def test_without_a_reader_of_orbits_the_remedy_is_reported(tmp_path):
    with pytest.raises(PluginError, match=r"install \./plugins/opir_readers"):
        orbit_of(OrbitConfig(file=OmmFileConfig(path="x")), EPOCH_US)
    assert Host.of().readers() == []


def test_the_default_field_of_regard_follows_the_orbit():
    def half_deg(**settings):
        sensor = {"model": "SBIRS-GEO", "id": "S", **settings}
        plan = compile_plan(scene_from_mapping({**SCENE, "targets": [], "sensors": [sensor]}))
        return math.degrees(plan.sensors[0].field_of_regard_half_angle_rad), plan.sensors[
            0
        ].settings

    assert half_deg(orbital_slot_deg=-100.0)[0] == pytest.approx(10.0)
    assert half_deg(orbit={"slot": {"lon_deg": -100.0, "inclination_deg": 5.0}})[
        0
    ] == pytest.approx(10.0)
    low, settings = half_deg(orbit=ORBIT)
    assert low == pytest.approx(math.degrees(math.asin(6378.137 / 7578.137)) + 1.3, abs=0.01)
    assert settings["field_of_regard_half_angle_deg"] == pytest.approx(low)
    assert half_deg(orbit=ORBIT, field_of_regard_half_angle_deg=20.0)[0] == pytest.approx(20.0)
