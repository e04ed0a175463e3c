"""Eclipses and solar outages against astropy's Sun (its own ephemeris and its Earth orientation,
nothing downloaded).

The reference shares no code with opir: Kepler orbits by Newton's iteration, the Sun's limb as 180
points, each asked whether the straight line to it meets the ellipsoid, and every event by sampling
and bisection.
"""

from itertools import pairwise

import numpy as np
import pytest
from astropy import units
from astropy.coordinates import ITRS, get_body
from astropy.time import Time
from astropy.utils import iers
from opir_testing import stub_sensor
from scipy.interpolate import CubicSpline

from opir_core.orbits import (
    KeplerConfig,
    OrbitConfig,
    eclipse_intervals,
    orbit_of,
    outage_intervals,
)

MU = 3.986004418e14
OMEGA = 7.292115e-5
RADII = np.array([6378137.0, 6378137.0, 6378137.0 * (1.0 - 1.0 / 298.257223563)])
SUN_RADIUS_M = 6.957e8
STEP_S = 20.0
#: opir takes UTC for UT1, from which it differed by up to 0.2 s on these dates.
TOLERANCE_S = 0.3
GEO_KM = (MU / OMEGA**2) ** (1.0 / 3.0) / 1e3
MOLNIYA_KM = GEO_KM / 2.0 ** (2.0 / 3.0)
TUNDRA_KM = GEO_KM


def orbit(axis_km, eccentricity=0.0, inclination=0.0, node=0.0, perigee=0.0, anomaly=0.0):
    return {
        "semi_major_axis_km": axis_km,
        "eccentricity": eccentricity,
        "inclination_deg": inclination,
        "lon_asc_node_deg": node,
        "arg_perigee_deg": perigee,
        "mean_anomaly_deg": anomaly,
    }


#: Name: epoch, hours, orbit, half angle of the field of regard and exclusion angle, deg.
GEOMETRIES = {
    "geo-spring-equinox": ("2024-03-20T12:00", 24, orbit(GEO_KM), 10.0, 5.0),
    "geo-autumn-equinox": ("2022-09-23T00:00", 24, orbit(GEO_KM, anomaly=105.0), 10.0, 5.0),
    "geo-early-season": ("2023-03-04T00:00", 24, orbit(GEO_KM, anomaly=-75.0), 10.0, 5.0),
    "geo-late-season": ("2021-10-08T00:00", 24, orbit(GEO_KM, anomaly=165.0), 10.0, 7.0),
    "geo-before-the-season": ("2020-02-20T00:00", 24, orbit(GEO_KM, anomaly=15.0), 10.0, 5.0),
    "geo-solstice": ("2023-06-21T00:00", 24, orbit(GEO_KM, anomaly=15.0), 10.0, 5.0),
    "geo-wide-exclusion": ("2023-09-01T00:00", 24, orbit(GEO_KM, anomaly=-135.0), 10.0, 15.0),
    "geo-inclined": (
        "2024-03-22T06:00",
        48,
        orbit(GEO_KM, 0.001, 6.0, 60.0, 10.0, 20.0),
        10.0,
        5.0,
    ),
    "molniya-1": ("2024-03-20T00:00", 24, orbit(MOLNIYA_KM, 0.72, 63.4, 10.0, 270.0), 12.0, 5.0),
    "molniya-2": (
        "2024-06-20T00:00",
        24,
        orbit(MOLNIYA_KM, 0.72, 63.4, -80.0, 270.0, 90.0),
        12.0,
        5.0,
    ),
    "molniya-3": (
        "2021-12-21T00:00",
        24,
        orbit(MOLNIYA_KM, 0.74, 63.4, 100.0, 270.0, 180.0),
        12.0,
        5.0,
    ),
    "molniya-4": (
        "2022-11-02T00:00",
        24,
        orbit(MOLNIYA_KM, 0.70, 63.4, 190.0, 270.0, 300.0),
        12.0,
        10.0,
    ),
    "tundra-1": ("2024-03-25T00:00", 48, orbit(TUNDRA_KM, 0.27, 63.4, 0.0, 270.0), 12.0, 5.0),
    "tundra-2": (
        "2023-10-01T00:00",
        48,
        orbit(TUNDRA_KM, 0.27, 63.4, 170.0, 270.0, 120.0),
        12.0,
        8.0,
    ),
    "leo-equinox": ("2024-03-20T12:00", 8, orbit(7578.137, 0.0, 60.0), 67.0, 5.0),
    "leo-solstice": ("2023-06-21T12:00", 8, orbit(7578.137, 0.0, 60.0, 120.0), 67.0, 5.0),
    "leo-polar": ("2022-02-01T12:00", 8, orbit(6978.137, 0.0, 90.0, 45.0), 67.0, 5.0),
    "leo-noon": ("2021-07-15T00:00", 8, orbit(6878.137, 0.001, 97.4, 180.0), 70.0, 3.0),
    "leo-equatorial": ("2020-12-01T00:00", 8, orbit(7378.137, 0.0, 2.0, -40.0), 65.0, 5.0),
    "leo-wide-field": ("2023-04-10T00:00", 8, orbit(7578.137, 0.0, 60.0, 250.0), 110.0, 5.0),
    "leo-high": ("2022-08-20T00:00", 8, orbit(8378.137, 0.0, 50.0, 300.0), 60.0, 5.0),
    "meo": ("2024-09-15T00:00", 24, orbit(26560.0, 0.0, 55.0, 200.0), 15.0, 5.0),
}


def position_m(elements, time_s):
    """The satellite in ECEF."""
    axis_m = elements["semi_major_axis_km"] * 1e3
    eccentricity = elements["eccentricity"]
    mean = np.radians(elements["mean_anomaly_deg"]) + np.sqrt(MU / axis_m**3) * time_s
    eccentric = mean + eccentricity * np.sin(mean)
    for _ in range(50):
        miss = eccentric - eccentricity * np.sin(eccentric) - mean
        eccentric = eccentric - miss / (1.0 - eccentricity * np.cos(eccentric))
    plane = np.stack(
        [
            np.cos(eccentric) - eccentricity,
            np.sqrt(1.0 - eccentricity**2) * np.sin(eccentric),
            0.0 * mean,
        ],
        axis=-1,
    )
    perigee, inclination, node = (
        np.radians(elements[f"{name}_deg"])
        for name in ("arg_perigee", "inclination", "lon_asc_node")
    )
    turned = turned_z(axis_m * plane, perigee)
    x, y, _ = turned.T
    tilted = np.stack([x, np.cos(inclination) * y, np.sin(inclination) * y], axis=-1)
    return turned_z(tilted, node - OMEGA * time_s)


def turned_z(vectors, angle):
    x, y, z = vectors.T
    cosine = np.cos(angle)
    sine = np.sin(angle)
    return np.stack([cosine * x - sine * y, sine * x + cosine * y, z], axis=-1)


def sun_of(epoch, hours):
    """The Sun in ECEF as a function of time, through astropy's positions every ten minutes."""
    knots_s = np.arange(-600.0, hours * 3600.0 + 1200.0, 600.0)
    with iers.conf.set_temp("auto_download", False), iers.conf.set_temp("auto_max_age", None):
        times = Time(epoch, scale="utc") + knots_s * units.s
        apparent = get_body("sun", times, ephemeris="builtin").transform_to(ITRS(obstime=times))
    inertial = turned_z(apparent.cartesian.xyz.to_value(units.m).T, OMEGA * knots_s)
    spline = CubicSpline(knots_s, inertial)
    return lambda time_s: turned_z(spline(time_s), -OMEGA * time_s)


def hidden_limb(position, sun):
    """The share of the points of the Sun's limb that the ellipsoid hides."""
    towards = sun - position
    distance = np.linalg.norm(towards, axis=1, keepdims=True)
    along = towards / distance
    first = np.cross(
        along, np.where(np.abs(along[:, 2:]) < 0.9, [[0.0, 0.0, 1.0]], [[1.0, 0.0, 0.0]])
    )
    first /= np.linalg.norm(first, axis=1, keepdims=True)
    second = np.cross(along, first)
    angle = np.linspace(0.0, 2.0 * np.pi, 180, endpoint=False)[:, None, None]
    # The limb lies where lines from the satellite touch the Sun's sphere.
    inside = (SUN_RADIUS_M / distance) ** 2
    radius = SUN_RADIUS_M * np.sqrt(1.0 - inside)
    limb = (
        sun
        - SUN_RADIUS_M**2 / distance * along
        + radius * (np.cos(angle) * first + np.sin(angle) * second)
    )
    start = position / RADII
    way = (limb - position) / RADII
    square = np.sum(way * way, axis=-1)
    product = np.sum(start * way, axis=-1)
    reach = product**2 - square * (np.sum(start * start, axis=-1) - 1.0)
    return np.mean((reach > 0.0) & (product < 0.0), axis=0)


def events(condition, stop_s):
    """The times at which a condition changes, by samples and bisection."""
    grid = np.arange(0.0, stop_s + STEP_S, STEP_S).clip(max=stop_s)
    state = condition(grid)
    changed = np.flatnonzero(state[1:] != state[:-1])
    low = grid[changed]
    high = grid[changed + 1]
    before = state[changed]
    for _ in range(16):
        middle = 0.5 * (low + high)
        is_before = condition(middle) == before
        low = np.where(is_before, middle, low)
        high = np.where(is_before, high, middle)
    return 0.5 * (low + high)


def inside(times, stop_s):
    """Times of opir without the ends of the interval asked for."""
    known = np.sort(times[np.isfinite(times)])
    return known[(known > 0.0) & (known < stop_s)]


#: Two days, or kinds of orbit that others stand for.
SLOW = {"geo-inclined", "molniya-2", "molniya-3", "molniya-4", "tundra-2"}


@pytest.fixture(
    scope="module",
    params=[pytest.param(name, marks=[pytest.mark.slow] * (name in SLOW)) for name in GEOMETRIES],
)
def geometry(request):
    epoch, hours, elements, field, exclusion = GEOMETRIES[request.param]
    epoch_us = int(np.datetime64(epoch, "us").astype(np.int64))
    sensor = stub_sensor(
        orbital_slot_deg=None,
        orbit=orbit_of(OrbitConfig(kepler=KeplerConfig(**elements)), epoch_us),
        field_of_regard_half_angle_rad=np.radians(field),
        solar_exclusion_rad=np.radians(exclusion),
    )
    sun = sun_of(epoch, hours)
    return sensor, epoch, hours * 3600.0, lambda time_s: (position_m(elements, time_s), sun(time_s))


def test_eclipses_begin_and_end_when_they_should(geometry):
    sensor, epoch, stop_s, states = geometry
    result = eclipse_intervals(sensor.orbit, epoch, 0.0, stop_s)
    outer = np.append(result.start_s, result.stop_s)
    inner = np.append(result.umbra_start_s, result.umbra_stop_s)
    penumbra = events(lambda time_s: hidden_limb(*states(time_s)) > 0.0, stop_s)
    umbra = events(lambda time_s: hidden_limb(*states(time_s)) == 1.0, stop_s)
    assert inside(outer, stop_s) == pytest.approx(penumbra, abs=TOLERANCE_S)
    assert inside(inner, stop_s) == pytest.approx(umbra, abs=TOLERANCE_S)
    for before, after in pairwise(np.stack([result.start_s, result.stop_s], axis=1)):
        assert before[1] < after[0]


def test_outages_begin_and_end_when_they_should(geometry):
    sensor, epoch, stop_s, states = geometry

    def is_blind(time_s):
        position, sun = states(time_s)
        down = -position
        towards = sun - position
        angle = np.arctan2(
            np.linalg.norm(np.cross(down, towards), axis=1), np.sum(down * towards, axis=1)
        )
        near = angle < sensor.field_of_regard_half_angle_rad + sensor.solar_exclusion_rad
        return near & (hidden_limb(position, sun) < 1.0)

    result = outage_intervals(sensor, epoch, 0.0, stop_s)
    expected = events(is_blind, stop_s)
    assert inside(np.concatenate([result.start_s, result.stop_s]), stop_s) == pytest.approx(
        expected, abs=TOLERANCE_S
    )


def test_the_geometries_have_eclipses_and_outages_of_every_orbit():
    kinds = {name.split("-")[0] for name in GEOMETRIES}
    assert len(GEOMETRIES) >= 20
    assert kinds == {"geo", "molniya", "tundra", "leo", "meo"}
