"""Files of layouts that stand beside those that are read: read, or refused with the way out."""

import json
from pathlib import Path

import pytest
from read_files import read, recognised, refusal
from satellite_elements import LINES, OMM

from opir_core.cli.main import main

BULLETIN = f"""SB KEPS @ ALL
Two-line elements, day 91 of 2026
TO ALL STATIONS

OSCAR 7
{LINES[0]}
{LINES[1]}
/EX
"""


def test_bulletins_of_elements_are_read_between_other_lines() -> None:
    assert recognised(BULLETIN) == ["tle"]
    (elements,) = read("tle", BULLETIN)
    assert elements["OBJECT_NAME"] == "OSCAR 7"
    assert (elements["TLE_LINE1"], elements["TLE_LINE2"]) == LINES
    lines = [note.partition(",")[0] for note in elements["NOTES"]]
    assert lines == ["line 1", "line 2", "line 3"]


def track(first: int, last: int) -> str:
    points = "".join(
        f"<when>2026-04-01T12:00:{second:02}Z</when><gx:coord>-120.6 34.7 {100 * second}</gx:coord>"
        for second in range(first, last)
    )
    return f"<gx:Track>{points}</gx:Track>"


def test_parts_of_a_multitrack_are_one_flight() -> None:
    text = (
        '<kml xmlns="http://www.opengis.net/kml/2.2" xmlns:gx="http://www.google.com/kml/ext/2.2">'
        "<Placemark><name>T</name><gx:MultiTrack><altitudeMode>absolute</altitudeMode>"
        f"{track(0, 10)}{track(10, 20)}{track(20, 25)}</gx:MultiTrack></Placemark></kml>"
    )
    table = read("kml", text)
    assert len(table.time_s) == 25
    assert table.time_s[-1] - table.time_s[0] == 24.0


def test_fire_pixels_are_named_as_sources() -> None:
    text = (
        "latitude,longitude,brightness,scan,track,acq_date,acq_time,satellite,confidence,frp\n"
        "34.0,-118.0,310,1.0,1.0,2026-04-01,1200,T,50,10\n"
    )
    words = refusal("csv", text)
    assert "places of fires, not a trajectory" in words
    assert "{model: fires, csv: FILE}" in words


def test_loggers_with_two_times_get_a_map_that_is_read() -> None:
    text = (
        "latitude,longitude,altitude(feet),speed(mph),time(millisecond),datetime(utc)\n"
        "34.7,-120.6,328.0,0.0,0.0,2026-04-01 12:00:10.000\n"
        "34.8,-120.6,521.0,55.0,5000.0,2026-04-01 12:00:15.000\n"
    )
    assert 'time_ms: "time(millisecond)"' in refusal("csv", text)
    names = {"lat_deg": "latitude", "lon_deg": "longitude", "height_ft": "altitude(feet)"}
    table = read("csv", text, columns={**names, "time_ms": "time(millisecond)"})
    assert table.time_s.tolist() == [0.0, 5.0]


def test_elements_that_a_scene_refuses_are_not_imported(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    path = tmp_path / "elements.json"
    path.write_text(json.dumps([{**OMM, "EPHEMERIS_TYPE": 4}]), encoding="utf-8")
    out = tmp_path / "sensors.yaml"
    assert main(["import", str(path), "--sensors", "LEO-WIDE", "--out", str(out)]) == 2
    assert "SGP4-XP, a theory that is not public" in capsys.readouterr().err
    assert not out.exists()
