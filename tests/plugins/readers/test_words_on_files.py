"""What commands say of files: which reader takes them, what is left out, what is a note."""

import json
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from command_line import main
from drawn_files import (
    SENSORS,
    elements,
    launch,
    lines_csv,
    lines_of,
    places_csv,
    states_csv,
    webcast_json,
    written,
)

Imported = Callable[..., str]
Capsys = pytest.CaptureFixture[str]


def rng(number: int) -> np.random.Generator:
    return np.random.Generator(np.random.Philox(number))


def tracked(path: Path, capsys: Capsys, *words: str) -> str:
    sensors = str(written(path.parent, "sensors.yaml", SENSORS))
    out = str(path.with_suffix(".jsonl"))
    command = ["track", str(path), "--sensors", sensors, "--out", out, "--tracker", "kepler-arc"]
    assert main([*command, *words]) == 0
    printed = capsys.readouterr()
    return printed.err + printed.out


def with_names(text: str, *names: str) -> str:
    return "\n".join([",".join(names), *text.splitlines()[1:], ""])


def test_a_map_of_columns_chooses_the_reader(
    tmp_path: Path, capsys: Capsys, imported: Imported
) -> None:
    names = ("wann", "wer", "peilung", "hoehe", "streuung")
    path = written(tmp_path, "lines.csv", with_names(lines_csv(lines_of(rng(1))), *names))
    columns = "timestamp=wann,sensor_id=wer,azimuth_deg=peilung,elevation_deg=hoehe"
    text = tracked(path, capsys, "--columns", columns)
    assert "180 detections (sights)" in text
    assert "note:" in text
    assert "columns that are not read: 'streuung'" in text
    assert "180 lines of sight" in imported(path, "--columns", columns)


def test_a_quantity_that_no_reader_has_is_refused(tmp_path: Path, imported: Imported) -> None:
    path = written(tmp_path, "lines.csv", lines_csv(lines_of(rng(1))))
    text = imported(path, "--columns", "azimut_deg=azimuth_deg", code=2)
    assert "azimut_deg is no quantity with its unit; did you mean azimuth_deg?" in text


def test_dates_may_have_decimal_commas(tmp_path: Path, capsys: Capsys) -> None:
    lines = lines_csv(lines_of(rng(2))).replace(",", ";").replace(".", ",")
    assert "180 detections (sights)" in tracked(written(tmp_path, "l.csv", lines), capsys)


def test_a_single_detection_has_no_plural(tmp_path: Path, capsys: Capsys) -> None:
    lines = "\n".join(lines_csv(lines_of(rng(3))).splitlines()[:2])
    assert "1 detection (sights)" in tracked(written(tmp_path, "l.csv", lines), capsys)


def test_lines_that_stand_twice_count_once(tmp_path: Path, capsys: Capsys) -> None:
    head, *lines = lines_csv(lines_of(rng(4))).splitlines()
    rows = [f"{line},x" for line in (*lines[:2], lines[0], *lines[2:], lines[3])]
    path = written(tmp_path, "l.csv", "\n".join([f"{head},remark", *rows]))
    text = tracked(path, capsys)
    assert "line 4: repeats line 2: time, sensor and direction; 2 of 182 detections" in text
    assert "180 detections (sights)" in text
    assert "columns that are not read: 'remark'" in text


def test_the_highest_speed_is_that_of_the_velocities(tmp_path: Path, imported: Imported) -> None:
    path = launch(rng(5), 5.0)
    text = imported(written(tmp_path, "s.csv", states_csv(path, path.ground_rate)))
    fastest = np.linalg.norm(path.ground_rate, axis=1).max()
    assert f"highest speed {fastest:.6g} m/s" in text


def test_notes_are_no_warnings(tmp_path: Path, imported: Imported) -> None:
    path = written(tmp_path, "w.json", webcast_json(launch(rng(6), 1.0)))
    text = imported(path, "--site=34.7,-120.6,100,270")
    assert "note: speed smoothed to a noise of" in text
    assert "warning:" not in text


def test_telemetry_of_two_stages_names_the_stage_that_is_taken(
    tmp_path: Path, imported: Imported
) -> None:
    second = json.loads(webcast_json(launch(rng(7), 1.0)))
    stages = [{"stage": 1, "telemetry": second[:120]}, {"stage": 2, "telemetry": second}]
    path = written(tmp_path, "w.json", json.dumps(stages))
    text = imported(path, "--site=34.7,-120.6,100,270")
    assert "note: of several stages 'stage 2' is taken, the longest; not 'stage 1'" in text


def test_stages_that_follow_each_other_are_one_flight(tmp_path: Path, imported: Imported) -> None:
    points = json.loads(webcast_json(launch(rng(7), 1.0)))
    whole = written(tmp_path, "w.json", json.dumps(points))
    expected = imported(whole, "--site=34.7,-120.6,100,270")
    for row, point in enumerate(points):
        point["stage"] = 1 if row < 100 else 2
    written(tmp_path, "w.json", json.dumps(points))
    assert imported(whole, "--site=34.7,-120.6,100,270") == expected
    assert "several stages" not in expected


@pytest.mark.parametrize(
    ("name", "sensor_id"),
    [
        ("Космос-2546", "Kosmos-2546"),
        ("Ресурс-П № 4", "Resurs-P-No-4"),
        ("Ελλάς Sat", "Ellas-Sat"),
        ("Türksat 4A", "Turksat-4A"),
        ("天宫-2", "SAT-25544"),
        ("A\x1b[31mB\nforged: line", "A-31mB-forged-line"),
    ],
)
def test_ids_keep_a_readable_form(
    tmp_path: Path, imported: Imported, name: str, sensor_id: str
) -> None:
    row = {**elements(rng(8)), "OBJECT_NAME": name, "NORAD_CAT_ID": 25544}
    path = written(tmp_path, "omm.json", json.dumps([row]))
    text = imported(path, "--sensors", "LEO-WIDE")
    assert f'"id": "{sensor_id}"' in text
    assert "\x1b" not in text
    assert not any(line.startswith("forged") for line in text.splitlines())


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("$GPGGA,120010.00,3442.0,N,12036.0,W,1,08,0.9,100.0,M,-33.0,M,,*47\n" * 3, "NMEA 0183"),
        (
            "MSG,3,1,1,4CA2E8,1,2026/04/01,12:00:10.123,,,,37000,,,34.7,-120.6,,\n" * 3,
            "SBS messages",
        ),
        (
            '"Peak Brightness Date/Time (UT)","Latitude (deg.)"\n"2013-02-15 03:20:33","54.8N"\n',
            "fireballs of CNEOS, a flash a line and no trajectory: bolides are sources",
        ),
    ],
)
def test_other_formats_are_named(tmp_path: Path, imported: Imported, text: str, words: str) -> None:
    assert words in imported(written(tmp_path, "f.txt", text), code=2)


def test_a_modified_julian_day_of_a_spreadsheet_is_told(tmp_path: Path, imported: Imported) -> None:
    head, *lines = places_csv(launch(rng(9), 5.0)).splitlines()
    days = [46_113.5 + float(line.split(",")[0]) / 86_400.0 for line in lines]
    rows = [f"{day:.9f},{line.split(',', 1)[1]}" for day, line in zip(days, lines, strict=True)]
    path = written(tmp_path, "m.csv", "\n".join([head.replace("time_s", "mjd"), *rows]))
    text = imported(path)
    assert "note: mjd 46113.5 is 1985-02-17T12:00:00Z; as days of a spreadsheet it is" in text
    assert "2026-04-01T12:00:00Z: add 15018 to them and name the column mjd" in text
