"""Layouts that real programs write, each written anew: what is read of them, or why they are
refused.
"""

import gzip
import math
from pathlib import Path

import numpy as np
import pytest
from astropy import units
from astropy.time import Time
from read_files import EPOCH_US, READER, READERS, read, recognised, refusal

from opir_core.orbits.configs import OrbitFileConfig

STK = """stk.v.8.0
BEGIN Ephemeris
ScenarioEpoch {epoch}
CoordinateSystem {frame}
DistanceUnit Kilometers
EphemerisTimePosVel
{rows}
{more}
END Ephemeris
"""


def stk(epoch, rows, frame="Fixed", more=""):
    return read("stk", STK.format(epoch=epoch, rows=rows, frame=frame, more=more), 0)


def test_seconds_of_an_stk_ephemeris_count_leap_seconds():
    elapsed = [0.0, 43_199.0, 43_201.0, 86_401.0, 5.8e7]
    rows = "\n".join(f"{second} {7000 + 0.1 * k} 0 0 0 7.5 0" for k, second in enumerate(elapsed))
    table = stk("31 Dec 2005 12:00:00.000", rows)
    moments = Time("2005-12-31T12:00:00", scale="utc") + elapsed * units.s
    # By the calendar: on days with a leap second astropy's seconds since 1970 are stretched.
    calendar_s = moments.isot.astype("datetime64[us]").astype(np.int64) * 1e-6
    np.testing.assert_allclose(table.time_s, calendar_s, rtol=0.0, atol=1e-5)


def test_a_blank_in_an_stk_epoch_and_covariances_are_skipped():
    rows = "0 7000 0 0 0 7.5 0\n10 6999.9 75 0 0 7.5 0"
    table = stk("1 Apr 2026 12:00: 7.50000001", rows, "TEME", "CovarianceTimePos\n0 1 2 3 4 5 6")
    same = stk("1 Apr 2026 12:00:07.50000001", rows, "TEMEOfDate")
    np.testing.assert_array_equal(table.position_m, same.position_m)
    np.testing.assert_allclose(
        table.time_s, EPOCH_US * 1e-6 + np.array([7.5, 17.5]), rtol=0.0, atol=1e-6
    )


@pytest.mark.parametrize(
    ("epochs", "last"),
    [
        (("2026 3 31 23 58", "2026 3 31 24 0"), "2026-04-01T00:00:00"),
        (("2026 3 31 23 58", "2026 4 1 24 0"), "2026-04-01T00:00:00"),
        (("2026 3 31 16 58", "2026 3 31 16 60"), "2026-03-31T17:00:00"),
        (("2026 3 31 16 58", "2026 3 31 17 60"), "2026-03-31T17:00:00"),
        (("2026 3 31 0 0", "2026 4 0 0 2"), "2026-03-31T00:02:00"),
    ],
)
def test_epochs_of_sp3_that_are_counted_on(epochs, last):
    rows = "".join(
        f"*  {epoch}  0.0\nPG01{15000.0:14.6f}{20000.0 + k:14.6f}{5000.0:14.6f}\n"
        for k, epoch in enumerate(epochs)
    )
    text = f"#dP2026\n%c G  cc UTC ccc\n{rows}EOF\n"
    table = read("sp3", text, 0)
    assert table.time_s[1] == Time(last, scale="utc").unix


def test_sp3_without_positions_is_refused():
    assert refusal("sp3", "#dP2026\n%c G  cc UTC ccc\nEOF\n") == "has no satellite with a position"


def orbit_table(step_s, count, radius_m=7e6, with_velocities=True, rate_rad_s=None):
    rate = rate_rad_s
    if rate is None:
        rate = np.sqrt(3.986004418e14 / radius_m**3) - 7.292115e-5
    time_s = step_s * np.arange(count)
    angle = rate * time_s
    place = radius_m * np.stack([np.cos(angle), np.sin(angle), 0.0 * angle], axis=1)
    velocity = radius_m * rate * np.stack([-np.sin(angle), np.cos(angle), 0.0 * angle], axis=1)
    names = ["time_s", *(f"{axis}_ecef_m" for axis in "xyz")]
    columns = [time_s, place]
    if with_velocities:
        names += [f"v{axis}_ecef_m_s" for axis in "xyz"]
        columns.append(velocity)
    rows = [",".join(map(repr, row)) for row in np.column_stack(columns).tolist()]
    Path("orbit.csv").write_text("\n".join([",".join(names), *rows]))
    return "orbit.csv"


@pytest.mark.parametrize(
    ("step_s", "with_velocities", "is_read"),
    [
        (60, True, True),
        (800, True, True),
        (1800, True, False),
        (400, False, True),
        (800, False, False),
    ],
)
def test_long_steps_around_the_earth_are_refused(imported, step_s, with_velocities, is_read):
    path = orbit_table(float(step_s), 40, with_velocities=with_velocities)
    answer = imported(path, code=0 if is_read else 2)
    assert ("around the Earth from the state before it, in a step of" in answer) != is_read
    assert "its velocity is" not in answer


def test_a_satellite_that_stands_still_or_is_far_away_is_no_slip(imported):
    still = orbit_table(60.0, 40, 4.2164e7, rate_rad_s=1e-9)
    assert "warning" not in imported(still)
    far = orbit_table(600.0, 40, 2.5e8, rate_rad_s=-7.29e-5)
    assert "warning" not in imported(far)


def test_epochs_of_omm_by_the_day_of_the_year(tmp_path):
    text = (
        '[{{"OBJECT_NAME": "A", "EPOCH": "{}", "MEAN_MOTION": 15.7, "ECCENTRICITY": 0.0007,'
        ' "INCLINATION": 51.6,'
    )
    text += '"RA_OF_ASC_NODE": 247.5, "ARG_OF_PERICENTER": 130.5, "MEAN_ANOMALY": 325.0, "BSTAR": 0.0001}}]'
    texts = [text.format(epoch) for epoch in ("2026-04-01T12:00:00.5", "2026-091T12:00:00.5Z")]
    places = []
    for text in texts:
        (tmp_path / "one.json").write_text(text)
        orbit = READER["omm"].orbit(
            OrbitFileConfig(path=str(tmp_path / "one.json")), EPOCH_US, READERS
        )
        places.append(orbit.position_ecef_m(np.array([0.0, 60.0])))
    np.testing.assert_array_equal(*places)


def test_a_high_drag_term_is_taken():
    text = "1 27421U 02021A   02127.85807307  .02981010  00000-0  12150+1 0   183\n"
    text += "2 27421  98.7323 202.8830 0025574 214.2404 146.2022 14.22888671   546\n"
    (row,) = read("tle", text)
    assert "PROBLEM" not in row


KVN = """CCSDS_TDM_VERS = 2.0
META_START
TIME_SYSTEM = GPS
PARTICIPANT_1 = EYE
PARTICIPANT_2 = ONE
PATH = 2,1
ANGLE_TYPE = RADEC
REFERENCE_FRAME = EME2000
META_STOP
DATA_START
ANGLE_1 = 2026-04-01T12:00:18.000 10.5
ANGLE_2 = 2026-04-01T12:00:18.000 -4.25
MAG = 2026-04-01T12:00:18.000 3
DATA_STOP
"""
XML = """<?xml version="1.0"?>
<tdm id="CCSDS_TDM_VERS" version="2.0"><header/><body><segment><metadata>
<TIME_SYSTEM>GPS</TIME_SYSTEM><PARTICIPANT_1>EYE</PARTICIPANT_1><PARTICIPANT_2>ONE</PARTICIPANT_2><PATH>2,1</PATH>
<ANGLE_TYPE>RADEC</ANGLE_TYPE><REFERENCE_FRAME>EME2000</REFERENCE_FRAME></metadata><data>
<observation><EPOCH>2026-04-01T12:00:18.000</EPOCH><ANGLE_1>10.5</ANGLE_1></observation>
<observation><EPOCH>2026-04-01T12:00:18.000</EPOCH><ANGLE_2>-4.25</ANGLE_2></observation>
<observation><EPOCH>2026-04-01T12:00:18.000</EPOCH><MAG>3</MAG></observation>
</data></segment></body></tdm>
"""


def test_both_forms_of_a_tdm_have_the_same_angles():
    plain, tagged = ([{**row, "line": 0} for row in read("tdm", text)] for text in (KVN, XML))
    assert plain == tagged
    assert plain[0]["timestamp"].startswith("2026-04-01T12:00:00.000")
    assert recognised(KVN) == recognised(XML) == ["tdm"]


def test_a_tdm_in_xml_without_angles_says_what_it_has():
    reason = refusal("tdm", XML.replace("ANGLE_1", "MAG").replace("ANGLE_2", "MAG"))
    assert reason == "has no angles (ANGLE_1 and ANGLE_2); it has MAG"


ALTIMETER = """#version,serial,time,altitude,speed,latitude,longitude,altitude
6, 11, 0.0, 1320.0, 0.0, 32.93, -106.91, 1390.0
6, 11, 1.0, 1350.0, 60.0, 32.93, -106.91, 1420.0
"""


def test_the_second_column_of_a_name_is_chosen_by_its_number():
    assert recognised(ALTIMETER) == ["csv"]
    columns = {"time_s": "time", "lat_deg": "latitude", "lon_deg": "longitude"}
    lower, higher = (
        read("csv", ALTIMETER, columns={**columns, "height_m": name}).position_m
        for name in ("altitude", "altitude#2")
    )
    np.testing.assert_allclose(np.linalg.norm(higher - lower, axis=1), 70.0, rtol=0.0, atol=1e-6)
    reason = refusal("csv", ALTIMETER, columns={**columns, "height_m": "altitude#3"})
    assert "there is no column 'altitude#3'" in reason


def test_exponents_of_fortran_are_read():
    text = "time_s,x_ecef_m,y_ecef_m,z_ecef_m\n0,-2.5D6,-4.5D+06,3.5d6\n10,-2.51D6,-4.5D+06,3.5E6\n"
    np.testing.assert_array_equal(read("csv", text).position_m[0], [-2.5e6, -4.5e6, 3.5e6])


@pytest.mark.parametrize(
    ("content", "reported"),
    [
        (b"\x1f\x9d\x90abc", "compress (.Z)"),
        (b"BZh91AY", "bzip2"),
        (b"PK\x03\x04\x00\x00\xfb", "a ZIP file, a KMZ or a spreadsheet"),
        (b"\x89HDF\r\n\x1a\n", "HDF5 or netCDF 4"),
        (gzip.compress(b"PAR1\x15\x04", mtime=0), "is no whole Parquet file"),
        (b"MATLAB 5.0 MAT-file, Platform: PCWIN64\x00\x01IM", "is a MATLAB file: export CSV"),
        (b"\xd0\xcf\x11\xe0\xa1\xb1\x1a\xe1" + bytes(99), "is an Excel or Word file: export CSV"),
        (b"\x93NUMPY\x01\x00v\x00" + bytes(99), "is a NumPy array: export CSV"),
        (b"SQLite format 3\x00" + bytes(99), "is an SQLite database"),
        (gzip.compress(gzip.compress(b"time_s", mtime=0), mtime=0), "is compressed twice"),
        (bytes(range(256)) * 9, "is binary, not text"),
        (b"\x80\x04\x95" + bytes(60), "is binary, not text"),
        ("time_s,x".encode("utf-16-le"), "is UTF-16 without a byte-order mark; save it as UTF-8"),
    ],
)
def test_what_is_no_text_is_named(imported, content, reported):
    Path("file").write_bytes(content)
    assert reported in imported("file", code=2)


@pytest.mark.parametrize(
    ("text", "reported"),
    [
        ("CCSDS_OCM_VERS = 3.0\n", "a CCSDS OCM: export the trajectory as OEM"),
        ("CCSDS_ACM_VERS = 2.0\n", "a CCSDS ACM, which has no trajectory"),
        ("H1 CPF  2  AIU 2018  6 13\n", "ILRS predictions (CPF)"),
        (
            "*****\n Target body name: X\n$$SOE\n2461132.0, A.D., 1, 2\n$$EOE\n",
            "a table of JPL Horizons",
        ),
        (
            '[{"id": "document", "version": "1.0"}, {"id": "a", "position": {}}]',
            "looks like CZML: export",
        ),
        (
            '{"type": "FeatureCollection", "features": []}',
            "looks like GeoJSON, whose places have no times",
        ),
        (
            '<?xml version="1.0"?>\n<!DOCTYPE oem>\n<oem/>',
            "XML with a document type, which is not read",
        ),
        (
            "Dear colleague,\n\nthe trajectory is attached.\n",
            "looks like text without lines of numbers",
        ),
        (
            "x = load('a.csv');\nplot(x(:, 1), x(:, 2))\n",
            "looks like text without lines of numbers",
        ),
        (
            "ts,latitude,longitude,satellites\n0,39.4,-8.3,9\n",
            "it seems to have latitude and longitude, and no height",
        ),
    ],
)
def test_what_is_not_read_is_named(imported, text, reported):
    Path("file").write_text(text)
    assert reported in imported("file", code=2)


def test_an_oem_whose_header_is_out_of_order_has_one_reader():
    text = "COMMENT first\nCCSDS_OEM_VERS = 2.0\nCREATION_DATE = 2026-04-01T00:00:00\n"
    assert recognised(text) == ["oem"]


#: Directions of X and Y angles of GMAT, "Tracking data types": from the zenith X towards east
#: (south), then Y towards north (east).
@pytest.mark.parametrize(
    ("kind", "x_deg", "y_deg", "azimuth_deg", "elevation_deg"),
    [
        ("XEYN", 0.0, 0.0, None, 90.0),
        ("XEYN", 30.0, 0.0, 90.0, 60.0),
        ("XEYN", -30.0, 0.0, 270.0, 60.0),
        ("XEYN", 0.0, 50.0, 0.0, 40.0),
        ("XSYE", 30.0, 0.0, 180.0, 60.0),
        ("XSYE", -30.0, 0.0, 0.0, 60.0),
        ("XSYE", 0.0, 50.0, 90.0, 40.0),
        ("XEYN", 135.0, 0.0, 90.0, -45.0),
    ],
)
def test_gimbal_angles_of_a_tdm(kind, x_deg, y_deg, azimuth_deg, elevation_deg):
    text = KVN.replace("RADEC", kind).replace("10.5", str(x_deg)).replace("-4.25", str(y_deg))
    (row, *_) = read("tdm", text)
    assert row["elevation_deg"] == pytest.approx(elevation_deg, abs=1e-9)
    if azimuth_deg is not None:
        assert math.remainder(row["azimuth_deg"] - azimuth_deg, 360.0) == pytest.approx(
            0.0, abs=1e-9
        )
