"""STK ephemerides, and OEM in other time systems: the states of the same flight written
otherwise.
"""

from datetime import datetime, timedelta

import numpy as np
import pytest
from astropy.time import Time
from pyproj import Transformer
from read_files import read, refusal

STATES_KM = np.array(
    [
        [0.0, -5600.0, -2600.0, 2900.0, 1.5, -5.2, 2.6],
        [10.0, -5584.9, -2651.9, 2925.9, 1.52, -5.18, 2.58],
        [20.0, -5569.6, -2703.6, 2951.6, 1.54, -5.16, 2.56],
    ]
)

STK = """stk.v.4.3

# written for a test
BEGIN Ephemeris
    NumberOfEphemerisPoints {count}
    ScenarioEpoch            1 Apr 2026 12:00:30.500000
    CentralBody              Earth
    CoordinateSystem         {frame}
    DistanceUnit             {unit}
    {kind}
{lines}
END Ephemeris
"""
OEM = """CCSDS_OEM_VERS = 2.0
META_START
OBJECT_NAME = ONE
OBJECT_ID = 2026-001A
CENTER_NAME = EARTH
REF_FRAME = {frame}
TIME_SYSTEM = {system}
START_TIME = 2026-04-01T12:00:00
STOP_TIME = 2026-04-01T12:00:10
META_STOP
{lines}
"""


def lines_of(rows):
    return "\n".join(" ".join(map(repr, row)) for row in rows.tolist())


def stk(frame="Fixed", unit="Kilometers", kind="EphemerisTimePosVel", factor=1.0, columns=7):
    rows = STATES_KM[:, :columns] * np.array([1.0, *[factor] * (columns - 1)])
    return STK.format(frame=frame, unit=unit, kind=kind, count=len(rows), lines=lines_of(rows))


def oem(frame, system="UTC", ahead_s=0.0):
    start = datetime(2026, 4, 1, 12, 0, 30, 500000) + timedelta(seconds=ahead_s)
    moments = [(start + timedelta(seconds=row[0])).isoformat() for row in STATES_KM.tolist()]
    rows = [
        " ".join([moment, *map(repr, row[1:])])
        for moment, row in zip(moments, STATES_KM.tolist(), strict=True)
    ]
    return OEM.format(frame=frame, system=system, lines="\n".join(rows))


@pytest.mark.parametrize(
    ("frame", "other"),
    [("Fixed", "ITRF"), ("J2000", "EME2000"), ("ICRF", "ICRF"), ("TEMEOfDate", "TEME")],
)
def test_an_stk_ephemeris_has_the_states_of_the_oem(frame, other):
    table = read("stk", stk(frame))
    same = read("oem", oem(other))
    np.testing.assert_allclose(table.time_s, [30.5, 40.5, 50.5], rtol=0.0, atol=1e-6)
    np.testing.assert_allclose(table.position_m, same.position_m, rtol=0.0, atol=1e-3)
    np.testing.assert_allclose(table.velocity_m_s, same.velocity_m_s, rtol=0.0, atol=1e-6)
    assert [table.line_of(row) for row in range(3)] == [11, 12, 13]


@pytest.mark.parametrize(
    ("unit", "factor"), [("Meters", 1e3), ("Kilometers", 1.0), ("Feet", 1e3 / 0.3048)]
)
def test_units_and_kinds_of_stk(unit, factor):
    position = STATES_KM[:, 1:4] * 1e3
    for kind, columns in (("EphemerisTimePosVel", 7), ("EphemerisTimePos", 4)):
        table = read("stk", stk(unit=unit, factor=factor, kind=kind, columns=columns))
        np.testing.assert_allclose(table.position_m, position, rtol=0.0, atol=1e-3)
        assert (table.velocity_m_s is None) == (columns == 4)


def test_geodetic_places_of_stk_are_those_of_proj():
    lines = "0 34.73 -120.57 100.0\n5 34.73 -120.58 260.0"
    text = STK.format(
        frame="Fixed", unit="Meters", kind="EphemerisLLATimePos", count=2, lines=lines
    )
    to_ecef = Transformer.from_crs("EPSG:4979", "EPSG:4978")
    expected = [to_ecef.transform(34.73, -120.57, 100.0), to_ecef.transform(34.73, -120.58, 260.0)]
    np.testing.assert_allclose(read("stk", text).position_m, expected, rtol=0.0, atol=1e-3)


def test_kinds_of_stk_with_angles_have_the_same_places():
    """A geocentric latitude and a distance from the centre are those of the place; rates of angles
    are left.
    """
    places = np.array([[34.73, -120.57, 100.0], [34.731, -120.571, 900.0]])
    place = np.column_stack(Transformer.from_crs("EPSG:4979", "EPSG:4978").transform(*places.T))
    distance = np.linalg.norm(place, axis=1)
    centric = np.column_stack(
        [np.degrees(np.arcsin(place[:, 2] / distance)), places[:, 1], distance]
    )
    for kind, rows in (("EphemerisLLATimePosVel", places), ("EphemerisLLRTimePos", centric)):
        rates = np.ones((2, 3)) if kind.endswith("Vel") else np.ones((2, 0))
        rows = np.column_stack([[0.0, 5.0], rows, rates]).tolist()
        lines = "\n".join(" ".join(map(repr, row)) for row in rows)
        table = read(
            "stk", STK.format(frame="Fixed", unit="Meters", kind=kind, count=2, lines=lines)
        )
        np.testing.assert_allclose(table.position_m, place, rtol=0.0, atol=1e-3)
        assert table.velocity_m_s is None


@pytest.mark.parametrize(
    ("text", "reported"),
    [
        (
            stk(frame="B1950"),
            "CoordinateSystem is B1950; export the ephemeris in one of Fixed, J2000",
        ),
        (stk(unit="Cubits"), "DistanceUnit is Cubits; read are meters"),
        (stk(kind="EphemerisTimePosVelAcc"), "line 11: has 7 values; a state has 10"),
        (stk(kind="CovarianceTimePos"), "has states of the kind none; read are EphemerisTimePos"),
        (
            stk(kind="EphemerisMSLLLATimePos"),
            "has states of the kind EphemerisMSLLLATimePos; read are",
        ),
        (
            stk(kind="EphemerisTimePos(3)Vel(3)Thrust"),
            "of the kind EphemerisTimePos(3)Vel(3)Thrust; read are",
        ),
        (
            stk(kind="TimeFormat ISO-YMD\nEphemerisTimePosVel"),
            "TimeFormat is ISO-YMD; export times in seconds",
        ),
        (
            stk(kind="EphemerisLLATimePosVel"),
            "line 11: latitude -5600 and longitude -2600 deg are no place",
        ),
        (stk().replace("Earth", "Moon"), "CentralBody is Moon; only Earth is taken"),
        (
            stk().replace("1 Apr 2026", "2026-04-01"),
            "ScenarioEpoch is '2026-04-01 12:00:30.500000'; a time like",
        ),
        (stk().replace("-5600.0", "x"), "line 11: '0.0 x"),
    ],
)
def test_what_is_wrong_with_an_stk_ephemeris_is_reported(text, reported):
    assert reported in refusal("stk", text)


@pytest.mark.parametrize(
    ("system", "ahead_s"), [("TAI", 37.0), ("GPS", 18.0), ("TT", 69.184), ("UT1", 0.0)]
)
def test_an_oem_in_another_time_system_has_the_same_states(system, ahead_s):
    table = read("oem", oem("ITRF", system, ahead_s))
    same = read("oem", oem("ITRF"))
    np.testing.assert_allclose(table.time_s, same.time_s, rtol=0.0, atol=1e-6)


LEAP_DAYS = (
    "1972-06-30",
    "1985-06-30",
    "1999-01-01",
    "2005-12-31",
    "2006-01-01",
    "2012-07-01",
    "2016-12-31",
)


@pytest.mark.parametrize("system", ["TAI", "TT", "TDB"])
@pytest.mark.parametrize("day", [*LEAP_DAYS, "2026-04-01"])
def test_times_are_those_of_astropy(system, day):
    """On both sides of leap seconds and between them; the seconds since 1970 are those of the
    calendar.
    """
    for clock in ("00:00:01.250", "12:00:00.000", "23:59:58.000"):
        text = getattr(Time(f"{day}T{clock}", scale="utc"), system.lower()).isot
        moment = np.datetime64(f"{day}T{clock}", "us")
        rows = [f"{text} 7000 0 0 0 7 0", f"{text[:11]}23:59:59.999 7000 0 0 0 7 0"]
        table = read("oem", OEM.format(frame="ITRF", system=system, lines="\n".join(rows)), 0)
        expected = moment.astype(np.int64) * 1e-6
        assert table.time_s[0] == pytest.approx(expected, abs=3e-3)


def test_segments_of_stk_meet_at_times_that_stand_twice():
    rows = np.concatenate([STATES_KM[:2], STATES_KM[1:]])
    text = STK.format(
        frame="Fixed", unit="Kilometers", kind="EphemerisTimePosVel", count=4, lines=lines_of(rows)
    )
    boundaries = (
        "    BEGIN SegmentBoundaryTimes\n        10.0\n    END SegmentBoundaryTimes\n   "
        " EphemerisTimePosVel"
    )
    table = read("stk", text.replace("    EphemerisTimePosVel", boundaries))
    np.testing.assert_array_equal(table.run, [0, 0, 1, 1])
    np.testing.assert_allclose(table.time_s, [30.5, 40.5, 40.5, 50.5], rtol=0.0, atol=1e-6)


@pytest.mark.parametrize(
    "form",
    ["{0}-04-01T12:00:{1:04.1f}Z", "01 Apr {0} 12:00:{1:06.3f}", "{0}-04-01 12:00:{1:04.1f}"],
)
def test_dates_in_a_table_count_from_the_epoch_of_the_scene(form):
    rows = [
        f"{form.format(2026, 30.5 + 10 * k)};{x};{y};{z}"
        for k, (_, x, y, z, *_) in enumerate(STATES_KM.tolist())
    ]
    text = "\n".join(["time_utc;x_ecef_km;y_ecef_km;z_ecef_km", *rows])
    table = read("csv", text)
    np.testing.assert_allclose(table.time_s, [30.5, 40.5, 50.5], rtol=0.0, atol=1e-6)
    np.testing.assert_allclose(table.position_m, STATES_KM[:, 1:4] * 1e3)
    assert table.has_dates
    reason = refusal("csv", text.replace(rows[1].split(";")[0], "noon"))
    assert "line 3: time_utc is 'noon', no date" in reason
