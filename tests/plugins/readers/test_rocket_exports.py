"""Exports of rocket simulators: the same flight as each program writes it, and burns where its
engine is lit.
"""

import numpy as np
import pytest
from pyproj import Geod, Transformer
from read_files import read, recognised, refusal

LAT = 32.99
LON = -106.97
GROUND = 1400.0
SITE = {"lat_deg": LAT, "lon_deg": LON, "height_m": GROUND, "azimuth_deg": 60.0}
GEOD = Geod(ellps="WGS84")
TO_ECEF = Transformer.from_crs("EPSG:4979", "EPSG:4978", always_xy=True)
FT = 0.3048


def flight():
    """Return times, distances along azimuth 60 degrees, altitudes above the ground and thrust: 10 s
    of 40 m/s².
    """
    time = np.arange(0.0, 40.0, 0.5)
    is_lit = time < 10.0
    climb = np.where(
        is_lit, 15.0 * time**2, 1500.0 + 300.0 * (time - 10.0) - 4.9 * (time - 10.0) ** 2
    )
    return time, 8.0 * climb**0.5, climb, np.where(is_lit, 5000.0, 0.0)


def true_positions():
    _, distance, altitude, _ = flight()
    ones = np.ones_like(distance)
    lon, lat, _ = GEOD.fwd(LON * ones, LAT * ones, 60.0 * ones, distance)
    return np.stack(TO_ECEF.transform(lon, lat, altitude + GROUND), axis=1), lat, lon


def openrocket(unit="m", factor=1.0, places="local", events=True):
    time, distance, altitude, thrust = flight()
    _, lat, lon = true_positions()
    east = distance * np.sin(np.radians(60.0))
    north = distance * np.cos(np.radians(60.0))
    names = f"# Time (s),Altitude ({unit}),Vertical velocity (m/s),Thrust (N)"
    columns = [time, altitude / factor, np.gradient(altitude, time), thrust]
    if places == "local":
        names += f",Position East of launch ({unit}),Position North of launch ({unit})"
        columns += [east / factor, north / factor]
    if places == "angles":
        names += ",Latitude (°),Longitude (°)"
        columns += [lat, lon]
    rows = [",".join(f"{value:.9f}" for value in row) for row in np.stack(columns, axis=1).tolist()]
    if events:
        rows.insert(0, "# Event IGNITION occurred at t=0 seconds")
        rows.insert(1, "# Event LAUNCH occurred at t=0.01 seconds")
        rows.insert(22, "# Event BURNOUT occurred at t=10 seconds")
    return "\n".join(["# One (Up to date)", f"# {len(time)} data points", "#", names, *rows, ""])


def rasaero():
    time, distance, altitude, thrust = flight()
    names = (
        "Time (sec),Stage,Stage Time (sec),Thrust (lb),Vel-V (ft/sec),Altitude (ft),Distance (ft)"
    )
    rows = [
        f"{t},{'B' if t < 10 else 'S'},{t},{f / 4.4482216152605},{0},{h / FT!r},{d / FT!r}"
        for t, f, h, d in zip(time, thrust, altitude.tolist(), distance.tolist(), strict=True)
    ]
    return "\n".join([names, *rows, ""])


def rocketpy(columns="solution"):
    time, distance, altitude, _ = flight()
    _, lat, lon = true_positions()
    if columns == "solution":
        east = distance * np.sin(np.radians(60.0))
        north = distance * np.cos(np.radians(60.0))
        table = [time, east, north, altitude + GROUND]
        names = "Time (s),X (m),Y (m),Z (m),E0,E1,E2,E3,W1 (rad/s)"
        table += [np.zeros_like(time)] * 5
    else:
        table = [time, lat, lon, altitude]
        names = "Time (s), Latitude (°), Longitude (°), Altitude AGL (m)"
    rows = [",".join(f"{value:.9f}" for value in row) for row in np.stack(table, axis=1).tolist()]
    return "\n".join([f"# {names}", *rows, ""])


@pytest.mark.parametrize(
    ("text", "name"),
    [
        (openrocket(), "openrocket"),
        (openrocket("ft", FT), "openrocket"),
        (openrocket("km", 1e3, "angles"), "openrocket"),
        (openrocket(places="angles", events=False), "openrocket"),
        (rasaero(), "rasaero"),
        (rocketpy(), "rocketpy"),
        (rocketpy("places"), "rocketpy"),
    ],
)
def test_the_same_flight_of_each_program(text, name):
    assert recognised(text) == [name]
    table = read(name, text, site=SITE, start_s=100.0)
    np.testing.assert_allclose(table.time_s, flight()[0] + 100.0, rtol=0.0, atol=1e-9)
    # The longest way to write a place here has nine decimals of a kilometre or a degree.
    np.testing.assert_allclose(table.position_m, true_positions()[0], rtol=0.0, atol=1e-3)
    assert table.line_of(0) == next(
        n for n, row in enumerate(text.split("\n"), 1) if row[:1] in ("0", "-")
    )


@pytest.mark.parametrize("text", [openrocket(), openrocket(events=False), rasaero()])
def test_burns_are_those_of_events_or_thrust(text):
    (name,) = recognised(text)
    burns_s = read(name, text, site=SITE).burns_s
    np.testing.assert_allclose(burns_s, [[0.0, 10.0]], rtol=0.0, atol=1e-9)


def test_burns_by_acceleration_without_events_or_thrust():
    burns = read("rocketpy", rocketpy(), site=SITE).burns_s
    assert burns.shape == (1, 2)
    # The states are half a second apart, and accelerations averaged over two.
    np.testing.assert_allclose(burns, [[0.0, 10.0]], rtol=0.0, atol=1.01)


@pytest.mark.parametrize(
    ("text", "name", "site", "reported"),
    [
        (
            openrocket(places="none"),
            "openrocket",
            SITE,
            "has no places: export latitude and longitude",
        ),
        (
            openrocket(),
            "openrocket",
            None,
            "its places count from the launch point: set site: {lat_deg: …",
        ),
        (rasaero(), "rasaero", {"lat_deg": LAT, "lon_deg": LON}, "set site.azimuth_deg"),
        (
            openrocket(unit="furlong"),
            "openrocket",
            SITE,
            "'Altitude (furlong)' has the unit 'furlong'; known are",
        ),
    ],
)
def test_what_lacks_is_reported(text, name, site, reported):
    assert reported in refusal(name, text, site=site)
