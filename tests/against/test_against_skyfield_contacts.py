"""Contacts of ground stations with satellites against skyfield: its own SGP4 frames and search."""

import numpy as np
import pytest
from skyfield.api import EarthSatellite, load, wgs84
from skyfield.searchlib import find_discrete

from opir_core.geometry import geodetic_to_ecef
from opir_core.orbits import OrbitConfig, contact_intervals, orbit_of

DAY_S = 86_400.0
EPOCH = np.datetime64("2026-04-02T00:00:00", "us")
MASK_DEG = 10.0
#: Step of skyfield's search for satellites that stand high for hours, s; those in low orbits are
#: searched by their culminations.
STEP_S = 300.0
LOW_TURNS = 10.0
#: Latitude and longitude, deg, and height, m.
STATIONS = (
    (39.7, -104.8, 1700.0),
    (64.8, -147.7, 150.0),
    (21.3, -158.0, 5.0),
    (78.2, 15.4, 450.0),
    (-35.4, 148.9, 690.0),
    (13.5, 144.8, 100.0),
    (51.6, -1.3, 90.0),
    (-72.0, 2.5, 1270.0),
)
#: Inclination, node, eccentricity, argument of perigee and mean anomaly, deg; turns a day.
ORBITS = [
    (inclination, (37 * number) % 360, eccentricity, 270, (101 * number) % 360, turns)
    for number, (inclination, eccentricity, turns) in enumerate(
        [
            *((51.6, 0.001, 15.5),) * 4,
            *((97.8, 0.001, 14.8),) * 4,
            *((86.4, 0.0002, 14.34),) * 4,
            *((60.0, 0.001, 13.0),) * 2,
            *((63.4, 0.7, 2.006),) * 3,
            *((55.0, 0.01, 2.006),) * 2,
            (5.0, 0.001, 1.0027),
        ]
    )
]


def checksum(line: str) -> str:
    return line + str(sum(int(c) if c.isdigit() else c == "-" for c in line) % 10)


def elements(number: int) -> tuple[str, str]:
    """Return two lines of a satellite at 2026-04-01T12:00."""
    inclination, node, eccentricity, perigee, anomaly, turns = ORBITS[number]
    catalogue = 90000 + number
    first = f"1 {catalogue}U 26001A   26091.50000000  .00000000  00000-0  00000-0 0  999"
    second = (
        f"2 {catalogue} {inclination:8.4f} {node:8.4f} {round(eccentricity * 1e7):07d}"
        f" {perigee:8.4f} {anomaly:8.4f} {turns:11.8f}    1"
    )
    return checksum(first), checksum(second)


def skyfield_spans(number: int, station: tuple[float, float, float]) -> np.ndarray:
    """Return the times in contact on the day, (n, 2) s, by skyfield's frames and search."""
    scale = load.timescale(builtin=True)
    satellite = EarthSatellite(*elements(number), ts=scale)
    latitude, longitude, height = station
    place = wgs84.latlon(latitude, longitude, height)

    def is_up(time):
        return (satellite - place).at(time).altaz()[0].degrees > MASK_DEG

    is_up.step_days = STEP_S / DAY_S
    year, month, day = (int(part) for part in str(EPOCH)[:10].split("-"))
    start, stop = scale.utc(year, month, day), scale.utc(year, month, day + 1)
    if ORBITS[number][-1] > LOW_TURNS:
        times, kinds = satellite.find_events(place, start, stop, altitude_degrees=MASK_DEG)
        times = times[kinds != 1]
    else:
        times, _ = find_discrete(start, stop, is_up)
    edges = [*([0.0] if is_up(start) else []), *((times.tt - start.tt) * DAY_S).tolist()]
    return np.array([*edges, *([DAY_S] if len(edges) % 2 else [])]).reshape(-1, 2)


@pytest.mark.slow
def test_contacts_of_a_day_are_those_of_skyfield() -> None:
    off_s = list[float]()
    for number in range(len(ORBITS)):
        orbit = orbit_of(OrbitConfig(tle=elements(number)), int(EPOCH.astype(np.int64)))
        for station in STATIONS:
            station_m = geodetic_to_ecef(*np.radians(station[:2]), station[2])
            spans = contact_intervals(
                orbit, station_m, mask_rad=np.radians(MASK_DEG), start_s=0.0, stop_s=DAY_S
            )
            peer = skyfield_spans(number, station)
            assert len(spans) == len(peer), (number, station)
            off_s += np.abs(spans - peer).ravel().tolist()
    assert len(ORBITS) == 20
    assert len(off_s) > 1200
    assert max(off_s) < 1.0
