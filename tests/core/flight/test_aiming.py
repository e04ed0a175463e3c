"""Aiming: flights come down where they are to, from anywhere, and say so where they cannot."""

import math
from functools import partial

import numpy as np
import pytest
from hypothesis import given, strategies as st

from examples import examples
from opir_core.constants import EARTH_ROTATION_RAD_S
from opir_core.flight import Forces, aim, boost_profile, boost_profiles, kepler_impact
from opir_core.flight.aiming import surface_range_m
from opir_core.flight.forces import ZonalField
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
    there = Geodetic(*geodesic_direct(latitude, longitude, bearing, range_m), heights[1])
    return aim(
        Geodetic(latitude, longitude, heights[0]), there, ignition_s, profiles, **settings
    ), there


def random_flights(count, seed, **settings):
    rng = np.random.default_rng(seed)
    profiles = [PROFILES[k % len(PROFILES)] for k in range(count)]
    range_m = np.array(
        [rng.uniform(1.0002 * p.minimum_range_m, 0.9998 * p.maximum_range_m) for p in profiles]
    )
    latitude = np.arcsin(rng.uniform(-1, 1, count))
    longitude = rng.uniform(-np.pi, np.pi, count)
    return flights(
        latitude, longitude, rng.uniform(0, 2 * np.pi, count), range_m, profiles, **settings
    )


def assert_hits(flight, there):
    assert flight.converged.all()
    assert not any(flight.complaints)
    aim_m = geodetic_to_ecef(*there)
    np.testing.assert_allclose(
        np.linalg.norm(flight.impact_ecef_m - aim_m, axis=-1), flight.miss_m, atol=1e-9
    )
    assert flight.miss_m.max() <= 0.01


def test_every_class_hits_from_anywhere_to_anywhere():
    flight, there = random_flights(1000, 3)
    assert_hits(flight, there)
    assert (flight.impact_s > flight.burnout_s).all()


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
    there = Geodetic(np.full(len(PROFILES), latitude), 2.0, 0.0)
    away = np.array([0.5 * (p.minimum_range_m + p.maximum_range_m) for p in PROFILES]) / 6.371e6
    flight = aim(
        Geodetic(latitude - np.sign(latitude) * away, np.linspace(-3, 3, len(PROFILES)), 0.0),
        there,
        0.0,
        PROFILES,
    )
    assert_hits(flight, there)


@pytest.mark.slow
@pytest.mark.parametrize("share", [1e-6, 0.5, 1.0 - 1e-6])
@pytest.mark.parametrize("bearing", [0.0, math.pi / 2, math.pi, 1.5 * math.pi])
def test_the_whole_range_of_every_class_in_every_direction(share, bearing):
    range_m = np.array(
        [p.minimum_range_m + share * (p.maximum_range_m - p.minimum_range_m) for p in PROFILES]
    )
    range_m = np.clip(
        range_m,
        [p.minimum_range_m + 100 for p in PROFILES],
        [p.maximum_range_m - 100 for p in PROFILES],
    )
    for latitude in (-1.0, 0.0, 0.7):
        assert_hits(*flights(np.full(len(PROFILES), latitude), 3.1, bearing, range_m, PROFILES))


def test_heights_of_launch_and_aim_point_count():
    flight, there = random_flights(100, 6, heights=(2500.0, 4000.0))
    assert_hits(flight, there)
    np.testing.assert_allclose(ecef_to_geodetic(flight.impact_ecef_m).height_m, 4000.0, atol=1e-3)


@pytest.mark.parametrize("burn_time_s", [10.0, 300.0, 1000.0])
def test_other_burn_times_hit_too(burn_time_s):
    profiles = [profile.with_burn_time(burn_time_s) for profile in PROFILES]
    range_m = np.array([profile.reference_range_m for profile in profiles])
    flight, there = flights(
        np.full(len(PROFILES), 0.4), 1.0, 2.0, range_m, profiles, ignition_s=5.0
    )
    assert_hits(flight, there)
    assert flight.burnout_s.tolist() == [5.0 + burn_time_s] * len(PROFILES)


def test_turning_the_earth_under_a_scene_changes_nothing():
    turn = 1.2345
    rng = np.random.default_rng(8)
    latitude = np.arcsin(rng.uniform(-1, 1, 50))
    longitude = rng.uniform(-1, 1, 50)
    there = Geodetic(*geodesic_direct(latitude, longitude, rng.uniform(0, 6, 50), 8e6), 0.0)
    profiles = [boost_profile("ICBM_liquid")] * 50
    here = aim(Geodetic(latitude, longitude, 0.0), there, 0.0, profiles)
    turned = aim(
        Geodetic(latitude, longitude + turn, 0.0),
        there._replace(longitude_rad=there.longitude_rad + turn),
        0.0,
        profiles,
    )
    np.testing.assert_allclose(turned.azimuth_rad, here.azimuth_rad, rtol=1e-9)
    np.testing.assert_allclose(turned.burnout_speed_m_s, here.burnout_speed_m_s, rtol=1e-9)
    np.testing.assert_allclose(turned.impact_s, here.impact_s, rtol=1e-9)


def test_the_time_of_launch_only_shifts_the_flight():
    early, _ = random_flights(50, 9, ignition_s=0.0)
    late, _ = random_flights(50, 9, ignition_s=86164.1 * 3)
    assert late.azimuth_rad.tobytes() == early.azimuth_rad.tobytes()
    assert late.burnout_speed_m_s.tobytes() == early.burnout_speed_m_s.tobytes()
    np.testing.assert_allclose(
        late.impact_s - late.path.ignition_s, early.impact_s - early.path.ignition_s, atol=1e-9
    )
    turn = EARTH_ROTATION_RAD_S * 86164.1 * 3
    x = early.burnout_position_eci_m[:, 0]
    y = early.burnout_position_eci_m[:, 1]
    np.testing.assert_allclose(
        late.burnout_position_eci_m[:, 0],
        x * math.cos(turn) - y * math.sin(turn),
        rtol=1e-9,
        atol=1e-2,
    )


def test_a_target_is_aimed_as_if_alone():
    crowd, there = random_flights(40, 10)
    rng = np.random.default_rng(10)
    for row in (0, 1, 2, 3, 4, 39):
        part, _ = random_flights(40, 10)
        launch = ecef_to_geodetic(crowd.path.plane.launch_m[row])
        assert launch.height_m == pytest.approx(0.0, abs=1e-6)
        assert part.azimuth_rad[row] == crowd.azimuth_rad[row]
    order = rng.permutation(40)
    profiles = [PROFILES[k % 5] for k in range(40)]
    places = ecef_to_geodetic(crowd.path.plane.launch_m)
    whole = aim(places, there, 0.0, profiles)
    mixed = aim(
        Geodetic(*(v[order] for v in places)),
        Geodetic(there.latitude_rad[order], there.longitude_rad[order], 0.0),
        0.0,
        [profiles[k] for k in order],
    )
    for row in (3, 17):
        one = slice(row, row + 1)
        alone = aim(
            Geodetic(*(v[one] for v in places)),
            Geodetic(there.latitude_rad[one], there.longitude_rad[one], 0.0),
            0.0,
            profiles[one],
        )
        assert alone.azimuth_rad.tobytes() == whole.azimuth_rad[one].tobytes()
        assert alone.burnout_speed_m_s.tobytes() == whole.burnout_speed_m_s[one].tobytes()
    assert mixed.azimuth_rad.tobytes() == whole.azimuth_rad[order].tobytes()
    assert mixed.impact_ecef_m.tobytes() == whole.impact_ecef_m[order].tobytes()


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


def test_one_impossible_target_leaves_the_others_alone():
    profiles = [boost_profile("SRBM")] * 3
    flight, _ = flights(np.full(3, 0.3), 0.2, 1.0, np.array([3e5, 3e6, 4e5]), profiles)
    assert flight.converged.tolist() == [True, False, True]
    alone, _ = flights(np.array([0.3]), 0.2, 1.0, np.array([4e5]), profiles[:1])
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
    mu_m3_s2 = 1.01 * 3.986004418e14
    stronger = partial(kepler_impact, mu_m3_s2=mu_m3_s2)
    flight, there = random_flights(
        50, 12, forces=Forces(zonal=(), gravity=ZonalField(mu_m3_s2=mu_m3_s2))
    )
    assert_hits(flight, there)
    plain, _ = random_flights(50, 12)
    assert (flight.burnout_speed_m_s > plain.burnout_speed_m_s).all()
    _, point_m = stronger(plain.burnout_position_eci_m, plain.burnout_velocity_eci_m_s, 0.0)
    short = np.linalg.norm(
        point_m - kepler_impact(plain.burnout_position_eci_m, plain.burnout_velocity_eci_m_s)[1],
        axis=1,
    )
    assert short.min() > 100.0


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
    launch = Geodetic(*places[:2], 0.0)
    there = Geodetic(*places[2:], 0.0)
    flight = aim(launch, there, 0.0, [profile])
    within = profile.minimum_range_m <= flight.range_m[0] <= profile.maximum_range_m
    assert flight.converged[0] == within
    assert bool(flight.complaints[0]) != within


def test_surface_range_is_the_geodesic_s_to_ninety_metres():
    rng = np.random.default_rng(13)
    places = [np.arcsin(rng.uniform(-1, 1, 3000)), rng.uniform(-np.pi, np.pi, 3000)]
    others = [np.arcsin(rng.uniform(-1, 1, 3000)), rng.uniform(-np.pi, np.pi, 3000)]
    exact_m = geodesic_inverse(*places, *others).distance_m
    found_m = surface_range_m(*places, *others)
    error_m = np.abs(found_m - exact_m)
    assert error_m.max() < 90.0
    assert error_m[exact_m < 1e6].max() < 3.0
    assert error_m[exact_m > 1.6e7].max() == 0.0


@pytest.mark.parametrize(
    ("places", "range_m"),
    [
        ((0.1, 0.2, 0.1, 0.2), 0.0),
        ((0.1, np.pi, 0.1, -np.pi), 0.0),
        ((POLE, 0.0, POLE, 2.0), 0.0),
        ((POLE, 0.0, -POLE, 0.0), 20003931.46),
        ((0.0, 0.0, 0.0, np.pi), 20003931.46),
        ((0.0, 0.0, 0.0, 1.0), 6378137.0),
    ],
)
def test_surface_range_of_special_places(places, range_m):
    assert surface_range_m(*places) == pytest.approx(range_m, abs=20.0)
    if range_m == 0.0:
        assert surface_range_m(*places) == pytest.approx(0.0, abs=1e-8)
