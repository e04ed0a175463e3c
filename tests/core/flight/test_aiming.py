"""Aiming: flights come down where they are to, from anywhere, and say so where they cannot."""

import math

import numpy as np
import pytest
from attrs import evolve
from hypothesis import given, strategies as st
from lone_rows import assert_rows_independent

from examples import examples
from opir_core.constants import EARTH_ROTATION_RAD_S
from opir_core.flight import Forces, aim, boost_profile, boost_profiles, kepler_impact
from opir_core.flight.aiming import surface_range_m
from opir_core.geometry import (
    Geodetic,
    ecef_to_geodetic,
    eci_to_ecef_state,
    geodesic_direct,
    geodesic_inverse,
    geodetic_to_ecef,
)

PROFILES = tuple(boost_profiles().values())
POLE = math.pi / 2


def flights(
    latitude,
    longitude,
    bearing,
    range_m,
    profiles,
    *,
    heights=(0.0, 0.0),
    ignition_s=0.0,
    **settings,
):
    """Return flights from places over a range in a direction, and the aim points."""
    aims = Geodetic(*geodesic_direct(latitude, longitude, bearing, range_m), heights[1])
    places = Geodetic(latitude, longitude, heights[0])
    return aim(places, aims, ignition_s, list(profiles), **settings), aims


def drawn(count, seed):
    """Return latitudes, longitudes, bearings, ranges and profiles of launches from anywhere."""
    rng = np.random.default_rng(seed)
    profiles = np.array([PROFILES[k % len(PROFILES)] for k in range(count)])
    range_m = np.array(
        [rng.uniform(1.0002 * p.minimum_range_m, 0.9998 * p.maximum_range_m) for p in profiles]
    )
    latitude = np.arcsin(rng.uniform(-1, 1, count))
    longitude = rng.uniform(-np.pi, np.pi, count)
    return latitude, longitude, rng.uniform(0, 2 * np.pi, count), range_m, profiles


def random_flights(count, seed, **settings):
    return flights(*drawn(count, seed), **settings)


def assert_hits(flight, aims):
    assert flight.converged.all()
    assert not any(flight.complaints)
    miss_m = np.linalg.norm(flight.impact_ecef_m - geodetic_to_ecef(*aims), axis=-1)
    np.testing.assert_allclose(miss_m, flight.miss_m, atol=1e-9)
    assert flight.miss_m.max() <= 0.01


def test_every_class_hits_from_anywhere_to_anywhere():
    flight, aims = random_flights(1000, 3)
    assert_hits(flight, aims)
    assert (flight.impact_s > flight.burnout_s).all()
    assert ((flight.azimuth_rad >= 0.0) & (flight.azimuth_rad < 2 * np.pi)).all()


def test_the_impact_is_that_of_the_burnout_state():
    flight, _ = random_flights(50, 4, ignition_s=1234.5)
    duration_s, point_m = kepler_impact(
        flight.burnout_position_eci_m, flight.burnout_velocity_eci_m_s, 0.0
    )
    np.testing.assert_allclose(flight.burnout_s + duration_s, flight.impact_s, atol=1e-6)
    landed, _ = eci_to_ecef_state(point_m, point_m, flight.impact_s)
    np.testing.assert_allclose(landed, flight.impact_ecef_m, atol=1e-6)
    fixed = eci_to_ecef_state(
        flight.burnout_position_eci_m, flight.burnout_velocity_eci_m_s, flight.burnout_s
    )
    np.testing.assert_allclose(fixed[0], flight.burnout_position_ecef_m, atol=1e-6)
    np.testing.assert_allclose(fixed[1], flight.burnout_velocity_ecef_m_s, atol=1e-9)


def test_the_burnout_state_is_the_end_of_the_boost():
    flight, _ = random_flights(50, 5, ignition_s=77.0)
    position, velocity = flight.path.state(np.arange(50), flight.path.burnout_s)
    assert position.tobytes() == flight.burnout_position_ecef_m.tobytes()
    assert velocity.tobytes() == flight.burnout_velocity_ecef_m_s.tobytes()
    np.testing.assert_allclose(
        np.linalg.norm(velocity, axis=1), flight.burnout_speed_m_s, rtol=1e-12
    )


def test_the_flight_path_angle_follows_the_minimum_energy_rule():
    """A quarter of the additional range angle flatter than at the reference range."""
    profile = boost_profile("ICBM_solid")
    earth_m = 6371008.77
    ranges = np.array([6e6, 1e7, 1.5e7])
    flight, _ = flights(np.zeros(3), 0.0, 0.5, ranges, [profile] * 3)
    expected = math.radians(25.0) - 0.25 * (ranges - 1e7) / earth_m
    np.testing.assert_allclose(flight.burnout_flight_path_angle_rad, expected, atol=1e-5)


@pytest.mark.slow
@pytest.mark.parametrize("latitude", [POLE, -POLE, POLE - 1e-12, POLE - 1e-6, 0.0, 1e-300, -1.2])
@pytest.mark.parametrize("longitude", [math.pi, -math.pi, math.pi - 1e-12, 0.0])
def test_launches_at_poles_and_on_the_antimeridian(latitude, longitude):
    bearing = np.linspace(0.0, 2 * np.pi, len(PROFILES), endpoint=False)
    range_m = np.array([profile.reference_range_m for profile in PROFILES])
    assert_hits(*flights(np.full(len(PROFILES), latitude), longitude, bearing, range_m, PROFILES))


@pytest.mark.parametrize("latitude", [POLE, -POLE])
def test_aim_points_at_the_poles(latitude):
    aims = Geodetic(np.full(len(PROFILES), latitude), 2.0, 0.0)
    angle = np.array([0.5 * (p.minimum_range_m + p.maximum_range_m) for p in PROFILES]) / 6.371e6
    longitude = np.linspace(-3, 3, len(PROFILES))
    launch = Geodetic(latitude - np.sign(latitude) * angle, longitude, 0.0)
    assert_hits(aim(launch, aims, 0.0, PROFILES), aims)


@pytest.mark.slow
@pytest.mark.parametrize("share", [1e-6, 0.5, 1.0 - 1e-6])
@pytest.mark.parametrize("bearing", [0.0, math.pi / 2, math.pi, 1.5 * math.pi])
def test_the_whole_range_of_every_class_in_every_direction(share, bearing):
    low, high = np.array([(p.minimum_range_m, p.maximum_range_m) for p in PROFILES]).T
    range_m = np.clip(low + share * (high - low), low + 100, high - 100)
    for latitude in (-1.0, 0.0, 0.7):
        assert_hits(*flights(np.full(len(PROFILES), latitude), 3.1, bearing, range_m, PROFILES))


def test_heights_of_launch_and_aim_point_count():
    flight, aims = random_flights(100, 6, heights=(2500.0, 4000.0))
    assert_hits(flight, aims)
    np.testing.assert_allclose(ecef_to_geodetic(flight.impact_ecef_m).height_m, 4000.0, atol=1e-3)


@pytest.mark.parametrize("burn_time_s", [10.0, 300.0, 1000.0])
def test_other_burn_times_hit_too(burn_time_s):
    profiles = [profile.with_burn_time(burn_time_s) for profile in PROFILES]
    range_m = np.array([profile.reference_range_m for profile in profiles])
    latitude = np.full(len(PROFILES), 0.4)
    flight, aims = flights(latitude, 1.0, 2.0, range_m, profiles, ignition_s=5.0)
    assert_hits(flight, aims)
    assert flight.burnout_s.tolist() == [5.0 + burn_time_s] * len(PROFILES)


def test_turning_the_earth_under_a_scene_changes_nothing():
    latitude, longitude, *settings = drawn(50, 8)
    flight, _ = flights(latitude, longitude, *settings)
    turned, _ = flights(latitude, longitude + 1.2345, *settings)
    for name in ("azimuth_rad", "burnout_speed_m_s", "impact_s"):
        np.testing.assert_allclose(getattr(turned, name), getattr(flight, name), rtol=1e-9)


def test_the_time_of_launch_only_shifts_the_flight():
    at_epoch, _ = random_flights(50, 9, ignition_s=0.0)
    shifted, _ = random_flights(50, 9, ignition_s=86164.1 * 3)
    assert shifted.azimuth_rad.tobytes() == at_epoch.azimuth_rad.tobytes()
    assert shifted.burnout_speed_m_s.tobytes() == at_epoch.burnout_speed_m_s.tobytes()
    flight_s = shifted.impact_s - shifted.path.ignition_s
    np.testing.assert_allclose(flight_s, at_epoch.impact_s, atol=1e-9)
    turn = EARTH_ROTATION_RAD_S * 86164.1 * 3
    x, y, _ = at_epoch.burnout_position_eci_m.T
    turned = x * math.cos(turn) - y * math.sin(turn)
    np.testing.assert_allclose(shifted.burnout_position_eci_m[:, 0], turned, rtol=1e-9, atol=1e-2)


def test_aims_do_not_depend_on_other_targets():
    def results(*columns):
        flight, _ = flights(*columns)
        return flight.azimuth_rad, flight.burnout_speed_m_s, flight.impact_ecef_m

    order = np.random.default_rng(10).permutation(40)
    rows = (slice(3, 4), slice(17, 18), order)
    assert_rows_independent(results, *drawn(40, 10), rows=rows)


@pytest.mark.parametrize(
    ("range_m", "name", "words"),
    [
        (0.0, "SRBM", "the aim point is 0 km from the launch point; SRBM flies 50 to 1000 km"),
        (1e3, "SRBM", "the aim point is 1 km from the launch point; SRBM flies 50 to 1000 km"),
        (
            2.0e7,
            "ICBM_liquid",
            "the aim point is 20000 km from the launch point; ICBM_liquid flies 5500 to 16000 km",
        ),
        (
            4e6,
            "ICBM_solid",
            "the aim point is 4000 km from the launch point; ICBM_solid flies 5500 to 16000 km",
        ),
    ],
)
def test_ranges_no_class_member_flies_are_reported(range_m, name, words):
    flight, _ = flights(np.array([0.3]), 0.2, 0.0, range_m, [boost_profile(name)])
    assert flight.complaints == (words,)
    assert not flight.converged.any()
    for column in (flight.azimuth_rad, flight.burnout_speed_m_s, flight.impact_s, flight.miss_m):
        assert np.isnan(column).all()


def test_an_impossible_target_does_not_change_others():
    latitude = np.full(3, 0.3)
    profiles = [boost_profile("SRBM")] * 3
    flight, _ = flights(latitude, 0.2, 1.0, np.array([3e5, 3e6, 4e5]), profiles)
    assert flight.converged.tolist() == [True, False, True]
    alone, _ = flights(latitude[:1], 0.2, 1.0, np.array([4e5]), profiles[:1])
    assert flight.azimuth_rad[2] == alone.azimuth_rad[0]


def test_no_targets_are_no_trouble():
    flight = aim(Geodetic(0.0, 0.0, 0.0), Geodetic(0.0, 1.0, 0.0), 0.0, [])
    assert flight.complaints == ()
    assert flight.impact_ecef_m.shape == (0, 3)


def test_a_flight_that_never_comes_down_there_is_reported():
    """Aim points far above the apogee of a short flight."""
    flight, _ = flights(np.array([0.3]), 0.2, 1.0, 6e4, [boost_profile("SRBM")], heights=(0.0, 9e5))
    assert flight.complaints[0].startswith(
        "the aim point is 60 km from the launch point; no flight of SRBM was found"
    )
    assert not flight.converged[0]


def test_free_flight_under_other_forces_is_aimed_for_them():
    """Gravity a percent stronger, in place of any other force: aimed for it, flights hit; aimed
    without, they miss.
    """
    gravity = evolve(Forces().gravity, mu_m3_s2=1.01 * 3.986004418e14)
    flight, aims = random_flights(50, 12, forces=Forces(zonal=(), gravity=gravity))
    assert_hits(flight, aims)
    plain, _ = random_flights(50, 12)
    assert (flight.burnout_speed_m_s > plain.burnout_speed_m_s).all()
    state = plain.burnout_position_eci_m, plain.burnout_velocity_eci_m_s
    _, point_m = kepler_impact(*state, mu_m3_s2=gravity.mu_m3_s2)
    assert np.linalg.norm(point_m - kepler_impact(*state)[1], axis=1).min() > 100.0


@pytest.mark.slow
@examples(150)
@given(
    latitude=st.floats(-POLE, POLE),
    longitude=st.floats(-math.pi, math.pi),
    bearing=st.floats(0.0, 2 * math.pi),
    share=st.floats(0.0, 1.0),
    heights=st.tuples(st.floats(-500.0, 9000.0), st.floats(-500.0, 9000.0)),
    profile=st.sampled_from(PROFILES),
)
def test_any_launch_and_any_aim_within_range(latitude, longitude, bearing, share, heights, profile):
    low = profile.minimum_range_m + 100.0
    high = profile.maximum_range_m - 100.0
    range_m = low + share * (high - low)
    assert_hits(
        *flights(np.array([latitude]), longitude, bearing, range_m, [profile], heights=heights)
    )


@examples(100)
@given(
    places=st.tuples(*[st.floats(-POLE, POLE), st.floats(-math.pi, math.pi)] * 2),
    profile=st.sampled_from(PROFILES),
)
def test_any_two_places_are_hit_or_reported(places, profile):
    flight = aim(Geodetic(*places[:2], 0.0), Geodetic(*places[2:], 0.0), 0.0, [profile])
    within = profile.minimum_range_m <= flight.range_m[0] <= profile.maximum_range_m
    assert flight.converged[0] == within
    assert bool(flight.complaints[0]) != within


def test_surface_range_is_the_geodesic_s_to_ninety_metres():
    rng = np.random.default_rng(13)
    places = [
        angle
        for _ in range(2)
        for angle in (np.arcsin(rng.uniform(-1, 1, 3000)), rng.uniform(-np.pi, np.pi, 3000))
    ]
    exact_m = geodesic_inverse(*places).distance_m
    error_m = np.abs(surface_range_m(*places) - exact_m)
    assert error_m.max() < 90.0
    assert error_m[exact_m < 1e6].max() < 3.0
    assert error_m[exact_m > 1.6e7].max() == 0.0


@pytest.mark.parametrize(
    ("places", "range_m", "error_m"),
    [
        ((0.1, 0.2, 0.1, 0.2), 0.0, 1e-8),
        ((0.1, np.pi, 0.1, -np.pi), 0.0, 1e-8),
        ((POLE, 0.0, POLE, 2.0), 0.0, 1e-8),
        ((POLE, 0.0, -POLE, 0.0), 20003931.46, 20.0),
        ((0.0, 0.0, 0.0, np.pi), 20003931.46, 20.0),
        ((0.0, 0.0, 0.0, 1.0), 6378137.0, 20.0),
    ],
)
def test_surface_range_of_special_places(places, range_m, error_m):
    assert surface_range_m(*places) == pytest.approx(range_m, abs=error_m)
