"""Tables as the world writes them are read to the same states, or refused with the way to read them."""

import numpy as np
import pytest
from opir_readers.csv_table import csv_table
from pyproj import Transformer

from opir_core.errors import SceneError
from opir_core.planning.plan import compile_plan
from opir_core.plugin import BadFileError
from opir_core.reading import scene_from_mapping
from opir_core.scene import text_of

PLACES_M = np.array(
    [[-2643878.3, -4579331.6, 3566636.9], [-2644469.0, -4580354.6, 3567568.0], [-2646240.8, -4583423.6, 3570361.6]]
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
    ],
)
def test_the_same_states_written_otherwise_are_the_same(content):
    table = csv_table(text_of(content), 5.0)
    np.testing.assert_allclose(table.position_m, PLACES_M, rtol=0.0, atol=1e-3)
    assert table.time_s.tolist() == [5.0, 15.0, 25.0]


@pytest.mark.parametrize(("unit", "factor"), [("m", 1.0), ("km", 1e3), ("ft", 0.3048), ("nmi", 1852.0)])
def test_units_stand_in_names_and_in_maps(unit, factor):
    names = [f"{axis}_ecef_{unit}" for axis in "xyz"]
    lines = [",".join(map(repr, [row * 60.0, *(place / factor).tolist()])) for row, place in enumerate(PLACES_M)]
    text = "\n".join([",".join(["t", *names]), *lines])
    table = csv_table(text, 0.0, {"time_ms": "t"})
    np.testing.assert_allclose(table.position_m, PLACES_M, rtol=1e-12)
    assert table.time_s.tolist() == [0.0, 0.06, 0.12]
    other = csv_table(
        text.replace("_ecef_", "."), 0.0, {"time_ms": "t", **{name: name.replace("_ecef_", ".") for name in names}}
    )
    assert np.array_equal(table.position_m, other.position_m)


GEODETIC = """Time (s),Latitude (°),Longitude (°),Altitude ({unit}),Total velocity (m/s)
0.0,34.7300,-120.5700,{low},0.0
5.0,34.7300,-120.5701,{high},63.1
"""
MAP = {"time_s": "Time (s)", "lat": "Latitude (°)", "lon": "Longitude (°)"}


@pytest.mark.parametrize(("unit", "factor"), [("m", 1.0), ("ft", 0.3048), ("km", 1e3)])
def test_geodetic_columns_are_read_with_a_map_to_what_proj_makes_of_them(unit, factor):
    text = GEODETIC.format(unit=unit, low=100.0 / factor, high=260.0 / factor)
    with pytest.raises(BadFileError) as refused:
        csv_table(text, 0.0)
    proposed = 'set columns: {time_s: "Time (s)", lat_deg: "Latitude (°)", lon_deg: "Longitude (°)", '
    assert f'{proposed}height_{unit}: "Altitude ({unit})"}}' in str(refused.value)
    table = csv_table(text, 0.0, {**MAP, f"height_{unit}": f"Altitude ({unit})"})
    to_ecef = Transformer.from_crs("EPSG:4979", "EPSG:4978")
    expected = np.array([to_ecef.transform(34.73, -120.57, 100.0), to_ecef.transform(34.73, -120.5701, 260.0)])
    np.testing.assert_allclose(table.position_m, expected, rtol=0.0, atol=1e-3)
    assert table.notes == ("columns that are not read: 'Total velocity (m/s)'",)


HEAD = "time_s,x_ecef_m,y_ecef_m,z_ecef_m"


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
            "line 2: x_ecef_m is '7.000.000,5', not a finite number: it has both a point and a comma",
        ),
        (
            "t,x_ecef_m,y_ecef_m,z_ecef_m\n0,7e6,0,0\n",
            {"time_s": "T"},
            "there is no column 'T', which columns names; there are 't', 'x_ecef_m'",
        ),
        (
            "time_s,lat,lon,height\n0,134.7,30,0\n1,134.7,30,0\n",
            {},
            "line 2: latitude 134.7 and longitude 30 deg are no place; are the two swapped",
        ),
        ("time_s,lat,lon\n0,34.7,30\n", {}, "lacks the column height_m"),
    ],
)
def test_tables_that_are_none_are_reported_with_the_way_to_read_them(text, columns, reported):
    with pytest.raises(BadFileError) as refused:
        csv_table(text, 0.0, columns)
    assert reported in str(refused.value)


def test_velocities_in_local_axes_are_turned(tmp_path):
    """At 0° N 90° E east is -x, north is z and up is y."""
    text = "time_s,lat,lon,height,v_east_m_s,v_north_ft_s,v_up_km_s\n0,0,90,0,1,10,0.003\n1,0,90,3,1,10,0.003\n"
    table = csv_table(text, 0.0)
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
def test_a_map_of_unknown_quantities_is_refused(tmp_path, columns, reported):
    target = {"id": "T", "model": "table", "type": "IRBM", "file": "none.csv", "columns": columns}
    scene = {"scene": "x", "epoch": "2026-04-01T12:00:00Z", "duration_s": 9.0, "sensors": [{"constellation": "DSP"}]}
    with pytest.raises(SceneError) as refused:
        compile_plan(scene_from_mapping({**scene, "targets": [target]}))
    assert reported in str(refused.value)
