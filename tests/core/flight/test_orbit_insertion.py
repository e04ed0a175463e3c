"""Insertion into circular orbits: vis-viva, circularity, the profile of the table, and independence
of targets.
"""

import math

import numpy as np
import pytest
from lone_rows import assert_rows_independent

from opir_core.constants import EARTH_EQUATORIAL_RADIUS_M, EARTH_MU_M3_S2, EARTH_ROTATION_RAD_S
from opir_core.flight import ascent, propagate_kepler
from opir_core.flight.orbit_insertion import insertion
from opir_core.geometry import Geodetic, ecef_to_geodetic
from opir_core.scene import core_target_class

(PROFILE,) = core_target_class("SLV").profiles


def launches(count, seed):
    rng = np.random.default_rng(seed)
    latitude = np.arcsin(rng.uniform(-1, 1, count))
    longitude = rng.uniform(-np.pi, np.pi, count)
    place = Geodetic(latitude, longitude, rng.uniform(0.0, 3000.0, count))
    return (
        place,
        rng.uniform(0.0, 1e4, count),
        rng.uniform(0.0, 2.0 * np.pi, count),
        rng.uniform(150e3, 600e3, count),
    )


@pytest.fixture(scope="module")
def everywhere():
    """Flights from everywhere, in every direction, to every altitude that a scene may ask for."""
    place, ignition_s, azimuth_rad, altitude_m = launches(400, 1)
    return insertion(place, ignition_s, azimuth_rad, altitude_m, [PROFILE] * 400), altitude_m


def test_every_orbit_is_reached(everywhere):
    assert everywhere[0].converged.all()


def test_the_speed_at_burnout_is_that_of_vis_viva_for_a_circle(everywhere):
    flight, altitude_m = everywhere
    radius_m = np.linalg.norm(flight.burnout_position_eci_m, axis=1)
    np.testing.assert_allclose(radius_m, EARTH_EQUATORIAL_RADIUS_M + altitude_m, atol=1e-2)
    circular_m_s = np.sqrt(EARTH_MU_M3_S2 * (2.0 / radius_m - 1.0 / radius_m))
    np.testing.assert_allclose(
        np.linalg.norm(flight.burnout_velocity_eci_m_s, axis=1), circular_m_s, atol=1e-5
    )


def test_the_orbit_has_one_radius_and_comes_round(everywhere):
    flight, altitude_m = everywhere
    state = flight.burnout_position_eci_m, flight.burnout_velocity_eci_m_s
    radius_m = EARTH_EQUATORIAL_RADIUS_M + altitude_m
    period_s = 2.0 * np.pi * np.sqrt(radius_m**3 / EARTH_MU_M3_S2)
    for share in (0.25, 0.6, 1.0):
        position, _ = propagate_kepler(*state, share * period_s)
        np.testing.assert_allclose(np.linalg.norm(position, axis=1), radius_m, atol=0.05)
    np.testing.assert_allclose(position, state[0], atol=0.1)


def test_burns_last_as_the_profile_says_from_the_launch_point(everywhere):
    flight, _ = everywhere
    np.testing.assert_allclose(
        flight.burnout_s - flight.path.ignition_s, PROFILE.burn_time_s, rtol=1e-12
    )
    position, velocity = flight.path.state(np.arange(400), flight.path.ignition_s)
    np.testing.assert_allclose(position, flight.path.plane.launch_m, atol=1e-6)
    assert not velocity.any()


def test_the_table_s_burnout_is_circular_over_a_sphere_at_rest():
    """Over a sphere of 6371 km the table's speed is circular at 200 km, where its pitch exponent
    ends the climb.
    """
    course = ascent([PROFILE], np.zeros(1))
    altitude_m = core_target_class("SLV").after_burnout.altitude_m
    height_m = course.burnout_height_m(np.array([PROFILE.burnout_speed_m_s]))
    assert height_m[0] == pytest.approx(altitude_m, abs=20.0)
    circular_m_s = math.sqrt(EARTH_MU_M3_S2 / (6371e3 + altitude_m))
    assert PROFILE.burnout_speed_m_s == pytest.approx(circular_m_s, abs=0.05)


def test_the_earth_s_rotation_helps_east_and_hinders_west():
    place = Geodetic(np.zeros(2), np.zeros(2), np.zeros(2))
    azimuth_rad = np.array([0.5, 1.5]) * math.pi
    altitude_m = np.full(2, 200e3)
    flight = insertion(place, np.zeros(2), azimuth_rad, altitude_m, [PROFILE] * 2)
    turning_m_s = EARTH_ROTATION_RAD_S * (EARTH_EQUATORIAL_RADIUS_M + 200e3)
    circular_m_s = math.sqrt(EARTH_MU_M3_S2 / (EARTH_EQUATORIAL_RADIUS_M + 200e3))
    np.testing.assert_allclose(
        flight.burnout_speed_m_s, circular_m_s + np.array([-1.0, 1.0]) * turning_m_s, rtol=1e-6
    )


def test_from_a_pole_the_orbit_is_polar():
    place = Geodetic(np.full(3, 0.5 * math.pi), np.zeros(3), np.zeros(3))
    flight = insertion(
        place, np.zeros(3), np.array([0.0, 1.0, 4.0]), np.full(3, 300e3), [PROFILE] * 3
    )
    momentum = np.cross(flight.burnout_position_eci_m, flight.burnout_velocity_eci_m_s)
    # The rotation of the Earth at burnout, some 1000 km from the pole, leans the orbit by a degree.
    inclination_rad = np.arccos(momentum[:, 2] / np.linalg.norm(momentum, axis=1))
    np.testing.assert_allclose(inclination_rad, 0.5 * math.pi, atol=0.02)


def test_the_height_follows_from_the_equatorial_radius(everywhere):
    flight, altitude_m = everywhere
    place = ecef_to_geodetic(flight.burnout_position_ecef_m)
    above_m = place.height_m - altitude_m
    assert (above_m > -1.0).all()
    assert (above_m < 21.5e3).all()


def test_flights_do_not_depend_on_other_targets():
    def states(latitude, longitude, height_m, *columns):
        place = Geodetic(latitude, longitude, height_m)
        flight = insertion(place, *columns, [PROFILE] * len(latitude))
        return flight.burnout_position_ecef_m, flight.burnout_velocity_ecef_m_s

    place, *columns = launches(400, 1)
    rows = [slice(row, row + 1) for row in (0, 17, 399)]
    assert_rows_independent(states, *place, *columns, rows=rows)


def test_an_orbit_out_of_reach_is_said_not_to_be_reached():
    """A burn of 60 s cannot climb to 20 000 km."""
    place = Geodetic(np.zeros(2), np.zeros(2), np.zeros(2))
    profiles = [PROFILE, PROFILE.with_burn_time(60.0)]
    flight = insertion(place, np.zeros(2), np.zeros(2), np.array([200e3, 2e7]), profiles)
    assert flight.converged.tolist() == [True, False]
