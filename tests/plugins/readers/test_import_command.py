"""`opir import`: what it shows of a file is true of it, and what it writes flies as the file
does.
"""

import gzip
from pathlib import Path

import numpy as np
import pytest
from opir_readers.csv_table import csv_table
from opir_readers.formats import READERS
from opir_readers.import_command import columns_of_text
from opir_readers.reading import file_text, reader_of
from repository import ROOT

from opir_core.cli.main import main
from opir_core.errors import SceneError
from opir_core.planning.plan import compile_plan
from opir_core.plugin import BadFileError, FileReader
from opir_core.reading import scene_from_mapping

FLIGHT = ROOT / "tests" / "data" / "flights" / "in_view.csv"
GEODETIC = """Time (s);Latitude (°);Longitude (°);Altitude (km)
0;34,73;-120,57;0,1
5;34,73;-120,5701;0,26
10;34,7299;-120,5707;0,74
15;34,7297;-120,5720;1,545
"""
MAP = "time_s=Time (s),lat=Latitude (°),lon=Longitude (°),height_km=Altitude (km)"


@pytest.fixture
def reported(tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)

    def imported(*words, code=0):
        assert main(["import", *map(str, words)]) == code
        answer = capsys.readouterr()
        return answer.err if code else answer.out

    return imported


def test_what_it_understood_is_shown(reported):
    Path("g.csv").write_text(GEODETIC, encoding="utf-8-sig")
    lines = reported("g.csv", "--columns", MAP).splitlines()
    assert lines[0].startswith("g.csv: csv, lines of numbers")
    assert lines[1] == "  4 states, 0 s to 15 s, in steps of 5 to 5 s"
    assert lines[2].startswith(
        "  frame latitude, longitude, height above WGS 84, no velocities; times are seconds"
    )
    assert lines[3].startswith(
        "  first state 34.73000° N 120.57000° W, 100.0 m above WGS 84; ECEF -2668896.5, -4518255.2,"
    )
    assert lines[5].startswith("  highest speed 162.8")


def test_without_a_map_one_is_proposed(reported):
    Path("g.csv").write_text(GEODETIC, encoding="utf-8")
    assert 'height_km: "Altitude (km)"}' in reported("g.csv", code=2)


def test_what_it_writes_flies_as_the_file_does(reported):
    shown = reported(FLIGHT, "--out", "out.csv", "--type", "IRBM")
    assert '{id: T1, model: table, type: IRBM, file: "out.csv", start_s: 0}' in shown
    tables = [
        csv_table(Path(path).read_text(encoding="utf-8"), 0.0) for path in (FLIGHT, "out.csv")
    ]
    assert np.array_equal(tables[0].position_m, tables[1].position_m)
    assert np.array_equal(tables[0].burns_s - tables[0].time_s[0], tables[1].burns_s)
    scene = {
        "scene": "imported",
        "epoch": "2026-04-01T12:00:00Z",
        "duration_s": 60.0,
        "sensors": [{"constellation": "DSP"}],
        "targets": [{"id": "T1", "model": "table", "type": "IRBM", "file": "out.csv"}],
    }
    assert len(compile_plan(scene_from_mapping(scene)).targets.ids) == 1


def test_a_format_is_known_by_content_and_by_name(reported):
    (example,) = (reader.example for reader in READERS if reader.name == "oem")
    Path("o.csv").write_text(example)
    Path("o.gz").write_bytes(gzip.compress(example.encode()))
    for words in (("o.csv",), ("o.gz",), ("o.csv", "--as", "oem")):
        assert ": oem, CCSDS" in reported(*words)
    assert "2026-04-01T12:00:00Z to 2026-04-01T12:00:10Z" in reported("o.csv")
    assert "there is no reader 'eom'; there are csv, events, gpx, kml, " in reported(
        "o.csv", "--as", "eom", code=2
    )
    assert "is read as oem, which has no columns; omit columns" in reported(
        "o.csv", "--columns", "lat=a", code=2
    )


@pytest.mark.parametrize(
    ("text", "looks"),
    [
        ("<?xml version='1.0'?><a/>", "it looks like XML with the outermost element a;"),
        ("<!doctype html><html>", "it looks like a web page;"),
        ('{"a": 1, "b": 2}', "it looks like JSON with the keys a, b;"),
        ("[1, 2]", "it looks like JSON;"),
        (
            "CCSDS_OPM_VERS = 2.0\n",
            "it looks like a CCSDS OPM, which has one state: propagate it, and export an OEM;",
        ),
        (
            "     3.04           N: GNSS NAV DATA    M: MIXED            RINEX VERSION / TYPE",
            "it looks like RINEX;",
        ),
        ("HDF\r\n", "it looks like HDF5;"),
    ],
)
def test_a_format_that_is_not_read_is_named(text, looks):
    with pytest.raises(BadFileError) as refused:
        reader_of(text, READERS)
    assert looks in str(refused.value)
    assert "oem (CCSDS Orbit Ephemeris Message, keyword form)" in str(refused.value)


def test_two_readers_of_one_text_are_reported():
    twin = FileReader(
        name="twin", summary="", recognises=lambda text: True, example="", build=lambda *_: None
    )
    with pytest.raises(BadFileError, match="may be for several readers, csv and twin; say which"):
        reader_of("time_s", [*READERS, twin])


def test_a_contradiction_is_reported_and_nothing_is_written(reported):
    rows = [f"{t},{6.4e6 + 100.0 * t * t},0,0,{0.2 * t},0,0" for t in range(20)]
    names = "time_s,x_ecef_m,y_ecef_m,z_ecef_m,vx_ecef_m_s,vy_ecef_m_s,vz_ecef_m_s"
    Path("w.csv").write_text("\n".join([names, *rows]))
    assert "all look in km/s" in reported("w.csv", "--out", "out.csv", code=2)
    assert not Path("out.csv").exists()


@pytest.mark.parametrize(
    "content", [b"\x1f\x8b\x08nonsense", gzip.compress(b"time_s,x" * 99, mtime=0)[:-12]]
)
def test_a_gzip_file_that_is_not_whole_is_reported(tmp_path, content):
    (tmp_path / "x.gz").write_bytes(content)
    with pytest.raises(BadFileError, match="is no whole gzip file"):
        file_text(str(tmp_path / "x.gz"))


def test_a_small_file_of_endless_zeros_costs_no_more_than_the_largest_file(tmp_path):
    (tmp_path / "x.gz").write_bytes(gzip.compress(bytes(200_000_000), 9))
    with pytest.raises(BadFileError, match="is larger than 64000000 bytes"):
        file_text(str(tmp_path / "x.gz"))


def test_maps_of_the_command_line_may_have_commas_in_quotes():
    assert columns_of_text('time_s=T, height_ft="Alt, ft" ,lat=φ') == {
        "time_s": "T",
        "height_ft": "Alt, ft",
        "lat": "φ",
    }
    with pytest.raises(SceneError, match="'x' is not of the form quantity=column"):
        columns_of_text("time_s=T,x")
