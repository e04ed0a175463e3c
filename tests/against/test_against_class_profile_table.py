"""Boost and free flight against the class table that the profiles came with: a spherical Earth that
does not turn.

The courses every 5 s are in `tests/data/class_profiles.csv`; ranges, apogees and flight times came
with them, to three or four digits.
"""

import csv
import math

import numpy as np
import pytest
from repository import DATA

from opir_core.constants import EARTH_MU_M3_S2
from opir_core.flight.boost import BoostPath, LaunchPlane, ascent, boost_profiles
from opir_core.flight.kepler import propagate_kepler

COURSES = DATA / "class_profiles.csv"
RADIUS_M = 6371e3
PROFILES = boost_profiles()

#: Range over the ground, km, apogee, km, and time from ignition to impact, s.
FLIGHTS = {
    "SRBM": (300.0, 85.0, 306.0),
    "MRBM": (1300.0, 334.0, 632.0),
    "IRBM": (4000.0, 919.0, 1213.0),
    "ICBM_solid": (10000.0, 1624.0, 2195.0),
    "ICBM_liquid": (10000.0, 1732.0, 2314.0),
}


def path_over_a_sphere(profile):
    """Return a path from the north of a sphere, in the x-z plane."""
    course = ascent([profile], [profile.burnout_flight_path_angle_rad])
    plane = LaunchPlane(
        np.array([[0.0, 0.0, RADIUS_M]]),
        np.array([[0.0, 0.0, 1.0]]),
        np.array([[1.0, 0.0, 0.0]]),
        np.array([RADIUS_M]),
    )
    speed = np.array([profile.burnout_speed_m_s])
    burn = np.array([profile.burn_time_s])
    series = course.swept_series_rad(speed, plane.radius_m)
    return BoostPath(np.zeros(1), burn, speed, plane, course, course.climb_series_s(), series)


def table_rows(name):
    with COURSES.open(encoding="utf-8") as file:
        reader = csv.DictReader(line for line in file if not line.startswith("#"))
        rows = [row for row in reader if row["class"] == name]
    return {key: np.array([float(row[key]) for row in rows]) for key in rows[0] if key != "class"}


@pytest.mark.parametrize("name", sorted(FLIGHTS))
def test_courses_are_those_of_the_table(name):
    table = table_rows(name)
    path = path_over_a_sphere(PROFILES[name])
    times = table["t_s"]
    assert times[-1] == PROFILES[name].burn_time_s
    position, velocity = path.state(np.zeros(len(times), dtype=int), times)
    distance = np.linalg.norm(position, axis=1)
    speed = np.linalg.norm(velocity, axis=1)
    downrange = RADIUS_M * np.arctan2(position[:, 0], position[:, 2])
    np.testing.assert_allclose((distance - RADIUS_M) / 1e3, table["alt_km"], atol=0.003)
    np.testing.assert_allclose(downrange / 1e3, table["downrange_km"], atol=0.004)
    np.testing.assert_allclose(speed / 1e3, table["speed_km_s"], atol=1e-4)
    angle = np.degrees(np.arcsin(np.sum(position * velocity, axis=1)[1:] / (distance * speed)[1:]))
    np.testing.assert_allclose(angle, table["flight_path_angle_deg"][1:], atol=1e-4)


@pytest.mark.parametrize("name", sorted(FLIGHTS))
def test_free_flights_have_the_range_apogee_and_time_of_the_table(name):
    """The arc from burnout on the table's sphere: apogee by closed form, return to the ground by
    bisection.
    """
    range_km, apogee_km, time_s = FLIGHTS[name]
    profile = PROFILES[name]
    position, velocity = (
        v[0]
        for v in path_over_a_sphere(profile).state(
            np.zeros(1, dtype=int), np.array([profile.burn_time_s])
        )
    )
    r = np.linalg.norm(position)
    speed_squared = velocity @ velocity
    a = 1.0 / (2.0 / r - speed_squared / EARTH_MU_M3_S2)
    eccentricity = math.sqrt(
        1.0 - (np.linalg.norm(np.cross(position, velocity)) ** 2) / (EARTH_MU_M3_S2 * a)
    )
    assert (a * (1.0 + eccentricity) - RADIUS_M) / 1e3 == pytest.approx(apogee_km, abs=1.0)
    low = 0.5 * (time_s - profile.burn_time_s)
    high = 2.0 * time_s
    for _ in range(60):
        middle = 0.5 * (low + high)
        height = np.linalg.norm(propagate_kepler(position, velocity, middle)[0]) - RADIUS_M
        low, high = (middle, high) if height > 0.0 else (low, middle)
    landed = propagate_kepler(position, velocity, low)[0]
    assert profile.burn_time_s + low == pytest.approx(time_s, abs=1.0)
    assert RADIUS_M * np.arctan2(landed[0], landed[2]) / 1e3 == pytest.approx(range_km, rel=0.0005)
