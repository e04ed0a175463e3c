"""`opir import`: what it shows of a file is true of it, and what it writes flies as the file
does.
"""

import gzip
from pathlib import Path

import numpy as np
import pytest
from read_files import READER, read
from repository import ROOT

from opir_core import compile_plan, scene_from_mapping
from opir_core.errors import SceneError
from opir_core.plugin import FileReader, Host, hookimpl

FLIGHT = ROOT / "tests" / "data" / "flights" / "in_view.csv"
GEODETIC = """Time (s);Latitude (°);Longitude (°);Altitude (km)
0;34,73;-120,57;0,1
5;34,73;-120,5701;0,26
10;34,7299;-120,5707;0,74
15;34,7297;-120,5720;1,545
"""
SCENE = {
    "scene": "imported",
    "epoch": "2026-04-01T12:00:00Z",
    "duration_s": 60.0,
    "sensors": [{"constellation": "DSP"}],
    "targets": [{"id": "T1", "model": "table", "type": "IRBM", "file": "out.csv"}],
}
MAP = "time_s=Time (s),lat=Latitude (°),lon=Longitude (°),height_km=Altitude (km)"


def test_what_it_understood_is_shown(imported):
    Path("g.csv").write_text(GEODETIC, encoding="utf-8-sig")
    lines = imported("g.csv", "--columns", MAP).splitlines()
    assert lines[0].startswith("g.csv: csv, lines of numbers")
    assert lines[1] == "  4 states, 0 s to 15 s, in steps of 5 to 5 s"
    assert lines[2].startswith(
        "  frame latitude, longitude, height above WGS 84, no velocities; times are seconds"
    )
    assert lines[3].startswith(
        "  first state 34.73000° N 120.57000° W, 100.0 m above WGS 84; ECEF -2668896.5, -4518255.2,"
    )
    assert lines[5].startswith("  highest speed 162.8")


def test_without_a_map_one_is_proposed(imported):
    Path("g.csv").write_text(GEODETIC, encoding="utf-8")
    assert 'height_km: "Altitude (km)"}' in imported("g.csv", code=2)


def test_what_it_writes_flies_as_the_file_does(imported):
    shown = imported(FLIGHT, "--out", "out.csv", "--type", "IRBM")
    assert '{id: T1, model: table, type: IRBM, file: "out.csv", start_s: 0}' in shown
    tables = [read("csv", Path(path).read_text(encoding="utf-8")) for path in (FLIGHT, "out.csv")]
    assert np.array_equal(tables[0].position_m, tables[1].position_m)
    assert np.array_equal(tables[0].burns_s - tables[0].time_s[0], tables[1].burns_s)
    assert len(compile_plan(scene_from_mapping(SCENE)).targets.ids) == 1


def test_a_format_is_known_by_content_and_by_name(imported):
    example = READER["oem"].example
    Path("o.csv").write_text(example)
    Path("o.gz").write_bytes(gzip.compress(example.encode()))
    for words in (("o.csv",), ("o.gz",), ("o.csv", "--as", "oem")):
        assert ": oem, CCSDS" in imported(*words)
    assert "2026-04-01T12:00:00Z to 2026-04-01T12:00:10Z" in imported("o.csv")
    assert "there is no reader 'eom'; there are csv, events, gpx, kml, " in imported(
        "o.csv", "--as", "eom", code=2
    )
    assert "is read as oem, which has no columns; omit columns" in imported(
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
def test_a_format_that_is_not_read_is_named(imported, text, looks):
    Path("file").write_text(text)
    reason = imported("file", code=2)
    assert looks in reason
    assert "oem (CCSDS Orbit Ephemeris Message, keyword form)" in reason


class Twin:
    @hookimpl
    def opir_readers(self):
        yield FileReader(
            name="twin",
            summary="any text",
            recognises=lambda _: True,
            example="x",
            build=lambda *_: None,
        )


def test_two_readers_of_one_text_are_reported(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    Path("out.csv").write_text("time_s")
    host = Host.discover()
    host.register(Twin())
    with pytest.raises(SceneError, match="may be for several readers, csv and twin; say which"):
        compile_plan(scene_from_mapping(SCENE, host=host), host)


def test_a_contradiction_is_reported_and_nothing_is_written(imported):
    rows = [f"{t},{6.4e6 + 100.0 * t * t},0,0,{0.2 * t},0,0" for t in range(20)]
    names = "time_s,x_ecef_m,y_ecef_m,z_ecef_m,vx_ecef_m_s,vy_ecef_m_s,vz_ecef_m_s"
    Path("w.csv").write_text("\n".join([names, *rows]))
    assert "all look in km/s" in imported("w.csv", "--out", "out.csv", code=2)
    assert not Path("out.csv").exists()


@pytest.mark.parametrize(
    "content", [b"\x1f\x8b\x08nonsense", gzip.compress(b"time_s,x" * 99, mtime=0)[:-12]]
)
def test_a_gzip_file_that_is_not_whole_is_reported(imported, content):
    Path("x.gz").write_bytes(content)
    assert "is no whole gzip file" in imported("x.gz", code=2)


def test_a_small_file_of_endless_zeros_is_refused(imported):
    Path("x.gz").write_bytes(gzip.compress(bytes(200_000_000), 9))
    assert "is larger than 64000000 bytes" in imported("x.gz", code=2)


def test_maps_of_the_command_line_may_have_commas_in_quotes(imported):
    Path("a.csv").write_text("T;Alt, ft;φ;lon\n0;1000;34.7;-120.6\n1;1010;34.7;-120.6\n")
    out = imported("a.csv", "--columns", 'time_s=T, height_ft="Alt, ft" ,lat=φ')
    assert "first state 34.70000° N 120.60000° W, 304.8 m" in out
    reason = imported("a.csv", "--columns", "time_s=T,x", code=2)
    assert "'x' is not of the form quantity=column" in reason
