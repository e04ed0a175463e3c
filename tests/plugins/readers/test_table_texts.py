"""Tables as the world writes them are read to the same states, or refused with the way to read
them.
"""

import json
from pathlib import Path

import numpy as np
import pytest
from opir_readers import ecef_state
from pyproj import Transformer
from read_files import EPOCH_US, read, refusal

from opir_core import compile_plan, scene_from_mapping
from opir_core.errors import SceneError

PLACES_M = np.array(
    [
        [-2643878.3, -4579331.6, 3566636.9],
        [-2644469.0, -4580354.6, 3567568.0],
        [-2646240.8, -4583423.6, 3570361.6],
    ]
)
NAMES = ["time_s", "x_ecef_km", "y_ecef_km", "z_ecef_km"]
ROWS = [[10.0 * row, *(place / 1e3)] for row, place in enumerate(PLACES_M)]


def written(delimiter=",", decimal=".", end="\n", names=NAMES, head="", comment=""):
    lines = [delimiter.join(f"{value:.4f}".replace(".", decimal) for value in row) for row in ROWS]
    return head + end.join([comment + delimiter.join(names), *lines, ""])


@pytest.mark.parametrize(
    "content",
    [
        written().encode(),
        written().encode("utf-8-sig"),
        written().encode("utf-16"),
        b"\xfe\xff" + written().encode("utf-16-be"),
        written(delimiter=";", decimal=",").encode("utf-8-sig"),
        written(delimiter=";", decimal=",", end="\r\n").encode(),
        written(delimiter="\t").encode(),
        written(delimiter="\t", decimal=",").encode(),
        written(delimiter=" ").encode(),
        written(end="\r").encode(),
        written(end="\r\n").encode(),
        written(comment="# ").encode(),
        written(delimiter=";", comment="% ", head="# exported\n").encode(),
        written(delimiter=";", decimal=",", head="sep=;\n").encode(),
        written(delimiter=",", end=",\n", names=NAMES).encode(),
        written().replace("\n", "\n\n# between\n").encode(),
        written().replace(",", " , ").encode(),
        written(delimiter="|").encode(),
        written(names=["TIME_S", "X_ECEF_KM", "Y_Ecef_km", "z_ecef_km"]).encode(),
        written(names=["time [s]", "x_ecef (km)", "y_ecef [km]", "z_ecef [ km ]"]).encode(),
        written(head="Exported by a simulator\nRun,17\n\n").encode(),
        written()
        .replace(
            "time_s,x_ecef_km,y_ecef_km,z_ecef_km", "time,x_ecef,y_ecef,z_ecef\n[s],[km],[km],[km]"
        )
        .encode(),
        written(delimiter="  ")
        .replace("z_ecef_km\n", "z_ecef_km\n------  ---- ---- ----\n")
        .encode(),
        "\n".join(
            ",".join(f'"{cell}"' for cell in line.split(";"))
            for line in written(";", ",").split("\n")[:-1]
        ).encode(),
        written(head="Bahn über Süd\n\n").encode("cp1252"),
        json.dumps([dict(zip(NAMES, row, strict=True)) for row in ROWS]).encode(),
        json.dumps(
            {"of": "one", "states": [dict(zip(NAMES, row, strict=True)) for row in ROWS]}
        ).encode(),
        json.dumps(dict(zip(NAMES, zip(*ROWS, strict=True), strict=True))).encode(),
        "".join(json.dumps(dict(zip(NAMES, row, strict=True))) + "\n" for row in ROWS).encode(),
    ],
)
def test_the_same_states_written_otherwise_are_the_same(imported, content):
    Path("states").write_bytes(content)
    assert "states: csv, " in imported("states", "--start-s", "5", "--out", "out.csv")
    table = np.loadtxt("out.csv", delimiter=",", skiprows=1)
    np.testing.assert_allclose(table[:, 1:4], PLACES_M, rtol=0.0, atol=1e-3)
    assert table[:, 0].tolist() == [0.0, 10.0, 20.0]
    assert "3 states, 5 s to 25 s," in imported("states", "--start-s", "5")


@pytest.mark.parametrize(
    ("unit", "factor"), [("m", 1.0), ("km", 1e3), ("ft", 0.3048), ("nmi", 1852.0)]
)
def test_units_stand_in_names_and_in_maps(unit, factor):
    names = [f"{axis}_ecef_{unit}" for axis in "xyz"]
    lines = [
        ",".join(map(repr, [row * 60.0, *(place / factor).tolist()]))
        for row, place in enumerate(PLACES_M)
    ]
    text = "\n".join([",".join(["t", *names]), *lines])
    table = read("csv", text, columns={"time_ms": "t"})
    np.testing.assert_allclose(table.position_m, PLACES_M, rtol=1e-12)
    assert table.time_s.tolist() == [0.0, 0.06, 0.12]
    columns = {"time_ms": "t", **{name: name.replace("_ecef_", ".") for name in names}}
    mapped = read("csv", text.replace("_ecef_", "."), columns=columns)
    assert np.array_equal(table.position_m, mapped.position_m)


GEODETIC = """Time (s),Latitude (°),Longitude (°),Altitude ({unit}),Total velocity (m/s)
0.0,34.7300,-120.5700,{low},0.0
5.0,34.7300,-120.5701,{high},63.1
"""
MAP = {"time_s": "Time (s)", "lat": "Latitude (°)", "lon": "Longitude (°)"}


@pytest.mark.parametrize(("unit", "factor"), [("m", 1.0), ("ft", 0.3048), ("km", 1e3)])
def test_geodetic_columns_have_the_places_of_proj(unit, factor):
    text = GEODETIC.format(unit=unit, low=100.0 / factor, high=260.0 / factor)
    proposed = (
        'set columns: {time_s: "Time (s)", lat_deg: "Latitude (°)", lon_deg: "Longitude (°)", '
    )
    assert f'{proposed}height_{unit}: "Altitude ({unit})"}}' in refusal("csv", text)
    table = read("csv", text, columns={**MAP, f"height_{unit}": f"Altitude ({unit})"})
    to_ecef = Transformer.from_crs("EPSG:4979", "EPSG:4978")
    expected = np.array(
        [to_ecef.transform(34.73, -120.57, 100.0), to_ecef.transform(34.73, -120.5701, 260.0)]
    )
    np.testing.assert_allclose(table.position_m, expected, rtol=0.0, atol=1e-3)
    assert table.notes == ("columns that are not read: 'Total velocity (m/s)'",)


@pytest.mark.parametrize(
    ("text", "columns", "reported"),
    [
        ("0,1,2,3\n1,2,3,4\n", {}, "line 1: has numbers and no line of names above it"),
        (
            "time_s,x_ecef_m,y_ecef_m,z_ecef_m,vx_ecef_ms\n0,7e6,0,0,1\n",
            {},
            "'vx_ecef_ms' is no column that is read; did you mean vx_ecef_m_s?",
        ),
        (
            "time_s,x_ecef_m,y_ecef_m,z_ecef_m,vx_ecef_m_s\n0,7e6,0,0,1\n",
            {},
            "lacks the columns vy_ecef_m_s, vz_ecef_m_s",
        ),
        (
            "time_s;x_ecef_m;y_ecef_m;z_ecef_m\n0;7.000.000,5;0;0\n",
            {},
            (
                "line 2: x_ecef_m is '7.000.000,5', not a finite number: it has both a point and a"
                " comma"
            ),
        ),
        (
            "t,x_ecef_m,y_ecef_m,z_ecef_m\n0,7e6,0,0\n",
            {"time_s": "T"},
            "there is no column 'T', which columns names; there are 't', 'x_ecef_m'",
        ),
        (
            "time_s,lat,lon,height\n0,134.7,30,0\n1,134.7,30,0\n",
            {},
            "line 2: latitude 134.7 and longitude 30 deg are no place; set columns if the two are exchanged",
        ),
        ("time_s,lat,lon\n0,34.7,30\n", {}, "lacks the column height_m"),
        (
            "t,pos_x,pos_y,pos_z\n0,7e6,0,0\n",
            {},
            '{time_s: "t", x_ecef_m: "pos_x", y_ecef_m: "pos_y", z_ecef_m: "pos_z"}',
        ),
        (
            "elapsed_time_sec,geodetic_latitude_deg,longitude_deg,altitude_km\n0,1,2,3\n",
            {},
            'lat_deg: "geodetic_latitude_deg", lon_deg: "longitude_deg", height_km: "altitude_km"}',
        ),
        (
            (
                "t [s],ECEF X [km],ECEF Y [km],ECEF Z [km],Vx (km/sec),Vy (km/sec),Vz"
                " (km/sec)\n0,7000,0,0,1,2,3\n"
            ),
            {},
            'z_ecef_km: "ECEF Z [km]", vx_ecef_km_s: "Vx (km/sec)"',
        ),
        (
            "time,x_eci_km,y_eci_km,z_eci_km\n0,7000,0,0\n",
            {},
            "along inertial axes: with dates, set columns: {x_eme2000_km: X",
        ),
        (
            "time_s,x_teme_km,y_teme_km,z_teme_km\n0,7000,0,0\n1,7000,0,0\n",
            {},
            "line 1: positions along inertial axes need dates",
        ),
        (
            "time_s,lat,lon,altitude\n0,34.7,30,0\n1,34.7,30,1\n",
            {},
            "or for heights above the ellipsoid set columns: {height_m",
        ),
        ("04/01/2026 12:00:00,1,2,3\n", {}, "name the columns in a first line"),
        (
            "time,x_ecef,y_ecef,z_ecef\n04/01/2026 12:00:00,7e6,0,0\n",
            {},
            "line 2: timestamp is '04/01/2026 12:00:00', no date",
        ),
        ("time_s,x_ecef (furlong),y_ecef_m,z_ecef_m\n0,7e6,0,0\n", {}, "lacks the column x_ecef_m"),
    ],
)
def test_other_tables_are_refused_with_the_way_to_read_them(text, columns, reported):
    assert reported in refusal("csv", text, columns=columns)


def test_velocities_in_local_axes_are_turned():
    """At 0° N 90° E east is -x, north is z and up is y."""
    text = "time_s,lat,lon,height,v_east_m_s,v_north_ft_s,v_up_km_s\n0,0,90,0,1,10,0.003\n1,0,90,3,1,10,0.003\n"
    table = read("csv", text)
    np.testing.assert_allclose(table.velocity_m_s, [[-1.0, 3.0, 3.048]] * 2, rtol=0.0, atol=1e-9)


@pytest.mark.parametrize(
    ("columns", "reported"),
    [
        ({"elevation_m": "ALT"}, "targets[0].columns: elevation_m is no quantity with its unit"),
        (
            {"vx_ecef_ms": "VX"},
            "vx_ecef_ms is no quantity with its unit; did you mean vx_ecef_m_s?",
        ),
    ],
)
def test_a_map_of_unknown_quantities_is_refused(columns, reported):
    target = {"id": "T", "model": "table", "type": "IRBM", "file": "none.csv", "columns": columns}
    scene = {
        "scene": "x",
        "epoch": "2026-04-01T12:00:00Z",
        "duration_s": 9.0,
        "sensors": [{"constellation": "DSP"}],
    }
    with pytest.raises(SceneError) as refused:
        compile_plan(scene_from_mapping({**scene, "targets": [target]}))
    assert reported in str(refused.value)


def at_places(names, times):
    """Return the table of the places at times, whose columns have these names."""
    rows = [
        f"{time},{','.join(map(str, place))}" for time, place in zip(times, PLACES_M, strict=False)
    ]
    return read("csv", "\n".join([f"{names},x_ecef,y_ecef,z_ecef", *rows]), start_s=5.0)


@pytest.mark.parametrize(
    ("names", "times"),
    [
        ("time", ["2026-04-01T12:00:10Z", "2026-04-01T12:00:20Z"]),
        ("epoch", ["20260401T120010Z", "20260401T120020Z"]),
        ("utc", ["2026/04/01 12:00:10", "2026/4/1 12:00:20"]),
        ("utc", ["01.04.2026 12:00:10", "1.4.2026 12:00:20"]),
        ("utc", ["2026/091/12:00:10.000", "2026:091:12:00:20"]),
        ("utc", ["1 April 2026 12:00:10.000", "2026-Apr-01 12:00:20"]),
        ("Time (UTCG)", ["1 Apr 2026 12:00:10.000", "1 Apr 2026 12:00:20.000"]),
        ("timestamp", ["2026-04-01 14:00:10+02:00", "2026-04-01T05:00:20-0700"]),
        ("unix_time", ["1775044810", "1775044820.0"]),
        ("unix_time_ms", ["1775044810000", "1775044820000"]),
        ("gps_time", ["1459080028", "1459080038"]),
        ("MJD", ["61131.500115740740", "61131.500231481481"]),
        ("jd", ["2461132.00011574074", "2461132.00023148148"]),
        ("date,time", ["2026-04-01,12:00:10", "2026-04-01,12:00:20"]),
        ("date,time_s", ["01.04.2026,12:00:10.0", "01.04.2026,12:00:20.0"]),
    ],
)
def test_dates_are_read_as_they_are_written(names, times):
    table = at_places(names, times)
    assert table.has_dates
    np.testing.assert_allclose(table.time_s, [10.0, 20.0], rtol=0.0, atol=1e-3)


@pytest.mark.parametrize(
    "clocks", [("00:00:10", "0:00:20.0"), ("T+00:00:10", "T+00:00:20"), ("10", "20")]
)
def test_elapsed_times_count_from_the_start(clocks):
    table = at_places("time", clocks)
    assert not table.has_dates
    assert table.time_s.tolist() == [15.0, 25.0]


def test_seconds_count_where_dates_stand_beside_them():
    table = at_places("time_s,epoch", [f"{time},2026-04-01T12:00:00Z" for time in range(3)])
    assert table.time_s.tolist() == [5.0, 6.0, 7.0]


@pytest.mark.parametrize("delimiter", [",", " "])
def test_columns_without_names_are_mapped_by_their_numbers(delimiter):
    text = written(delimiter).split("\n", 1)[1]
    columns = {name: f"#{number}" for number, name in enumerate(NAMES, 1)}
    table = read("csv", text, columns=columns)
    np.testing.assert_allclose(table.position_m, PLACES_M, rtol=0.0, atol=1e-3)
    assert table.line_of(0) == 1
    named = read("csv", written(delimiter), columns={"x_ecef_km": "#2"})
    np.testing.assert_array_equal(named.position_m, table.position_m)


REPORT = """       Time (UTCG)              x (km)          y (km)          z (km)
------------------------    ------------    ------------    ------------
 1 Apr 2026 12:00:00.000    -2643.878300    -4579.331600     3566.636900
 1 Apr 2026 12:00:10.000    -2644.469000    -4580.354600     3567.568000
"""
SHIP = """Sat.UTCGregorian           Sat.EarthFixed.X        Sat.EarthFixed.Y        Sat.EarthFixed.Z
01 Apr 2026 12:00:00.000   -2643.8783              -4579.3316              3566.6369
01 Apr 2026 12:00:10.000   -2644.469               -4580.3546              3567.568
"""


@pytest.mark.parametrize(("text", "form"), [(REPORT, "{} (km)"), (SHIP, "Sat.EarthFixed.{}")])
def test_reports_whose_columns_stand_two_blanks_apart(text, form):
    axes = "xyz" if "km" in form else "XYZ"
    mapped = {f"{axis.lower()}_ecef_km": form.format(axis) for axis in axes}
    reason = refusal("csv", text)
    assert f'x_ecef_km: "{mapped["x_ecef_km"]}"' in reason or "x_ecef_m" in reason
    table = read("csv", text, columns=mapped)
    np.testing.assert_allclose(table.position_m, PLACES_M[:2], rtol=0.0, atol=1e-3)
    assert table.time_s.tolist() == [0.0, 10.0]


@pytest.mark.parametrize(("name", "frame"), [("eme2000", "EME2000"), ("teme", "TEME")])
def test_inertial_columns_are_turned_as_an_oem_in_their_frame(name, frame):
    state = np.array(
        [[7e6, 1e5, -2e5, 10.0, 7500.0, 30.0], [6.99e6, 1.75e5, -1.997e5, -70.0, 7499.0, 31.0]]
    )
    names = [f"{rate}{axis}_{name}" for rate in ("", "v") for axis in "xyz"]
    rows = [
        f"2026-04-01T12:00:{10 * row:02d}Z,{','.join(map(repr, values))}"
        for row, values in enumerate(state.tolist())
    ]
    table = read("csv", "\n".join([",".join(["time", *names]), *rows]))
    place, velocity = ecef_state(frame, state[:, :3], state[:, 3:], EPOCH_US, np.array([0.0, 10.0]))
    np.testing.assert_allclose(table.position_m, place, rtol=0.0, atol=1e-6)
    np.testing.assert_allclose(table.velocity_m_s, velocity, rtol=0.0, atol=1e-9)
    assert table.frame == frame
