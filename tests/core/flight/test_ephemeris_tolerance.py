"""Flights of every class as ephemerides: the tolerance holds at a million points, burnout and
impact included.
"""

import numpy as np
import pytest

from opir_core.flight import (
    Drag,
    Ephemeris,
    Forces,
    aim,
    boost_ephemeris,
    boost_profiles,
    coast_ephemeris,
    propagate,
    propagate_kepler,
)
from opir_core.geometry import Geodetic, eci_to_ecef, geodesic_direct

EACH = 20


def drawn_aims(count, seed, margin, ignited_within_s, **settings):
    """Return flights of every profile, `count` of each, from anywhere to anywhere in its range."""
    rng = np.random.default_rng(seed)
    profiles = [profile for profile in boost_profiles().values() for _ in range(count)]
    latitude = np.arcsin(rng.uniform(-1, 1, len(profiles)))
    longitude = rng.uniform(-np.pi, np.pi, len(profiles))
    limits = [
        ((1 + margin) * p.minimum_range_m, (1 - margin) * p.maximum_range_m) for p in profiles
    ]
    range_m = np.array([rng.uniform(*ends) for ends in limits])
    bearing = rng.uniform(0, 2 * np.pi, len(profiles))
    aims = Geodetic(*geodesic_direct(latitude, longitude, bearing, range_m), 0.0)
    ignition_s = rng.uniform(0.0, ignited_within_s, len(profiles))
    flight = aim(Geodetic(latitude, longitude, 0.0), aims, ignition_s, profiles, **settings)
    assert flight.converged.all()
    return flight


@pytest.fixture(scope="module")
def flight():
    return drawn_aims(EACH, 11, 1e-3, 1e5)


def flight_ephemeris(flight, tolerance_m):
    boost = boost_ephemeris(flight.path, tolerance_m)
    return Ephemeris.joined([boost, coast_ephemeris(flight, tolerance_m)])


def exact_m(flight, target, time_s):
    """Return the positions that the ephemeris stands for, without it."""
    boost, _ = flight.path.state(target, time_s)
    coast, _ = propagate_kepler(
        flight.burnout_position_eci_m[target],
        flight.burnout_velocity_eci_m_s[target],
        np.maximum(time_s - flight.burnout_s[target], 0.0),
    )
    return np.where(
        (time_s <= flight.burnout_s[target])[:, None], boost, eci_to_ecef(coast, time_s)
    )


@pytest.mark.parametrize(
    ("tolerance_m", "points"),
    [
        (0.01, 100_000),
        *(
            pytest.param(tolerance, 1_000_000, marks=pytest.mark.slow)
            for tolerance in (1.0, 0.01, 1e-4)
        ),
    ],
)
def test_points_anywhere_are_within_the_tolerance(flight, tolerance_m, points):
    """A third anywhere in the boost, a third crowded to pitch-over, where it bends most, a third in
    free flight.
    """
    rng = np.random.default_rng(12)
    path = flight.path
    ephemeris = flight_ephemeris(flight, tolerance_m)
    target = rng.integers(0, len(ephemeris), points)
    share = rng.random(points)
    crowded = 10.0 ** rng.uniform(-9.0, 0.0, points)
    starts = np.array([path.ignition_s, path.breakpoints_s()[:, 0], path.burnout_s])
    ends = np.array([path.burnout_s, path.burnout_s, flight.impact_s])
    third = np.arange(points) % 3
    start_s = starts[third, target]
    shares = np.where(third == 1, crowded, share)
    everyone = np.arange(len(ephemeris))
    edges = path.ignition_s, path.burnout_s, ephemeris.end_s
    target = np.concatenate([target, *[everyone] * 3])
    times = start_s + shares * (ends[third, target[:points]] - start_s)
    times = np.concatenate([times, *edges])
    miss_m = ephemeris.position_m(target, times) - exact_m(flight, target, times)
    assert 0.1 * tolerance_m < np.linalg.norm(miss_m, axis=1).max() <= tolerance_m


def test_flights_go_from_launch_to_impact_without_a_jump(flight):
    ephemeris = flight_ephemeris(flight, 0.01)
    everyone = np.arange(len(ephemeris))
    assert ephemeris.start_s.tobytes() == flight.path.ignition_s.tobytes()
    assert ephemeris.end_s.tobytes() == flight.impact_s.tobytes()
    launch_m, impact_m = (
        ephemeris.position_m(everyone, times) for times in (ephemeris.start_s, ephemeris.end_s)
    )
    np.testing.assert_allclose(launch_m, flight.path.plane.launch_m, atol=1e-6)
    np.testing.assert_allclose(impact_m, flight.impact_ecef_m, atol=1e-5)
    ends = boost_ephemeris(flight.path).state(everyone, flight.burnout_s)
    starts = coast_ephemeris(flight).state(everyone, flight.burnout_s)
    np.testing.assert_allclose(np.array(starts), np.array(ends), atol=1e-5)


def test_velocities_come_close_where_the_motion_is_smooth(flight):
    """At a tolerance of 1 cm: 1 mm/s in free flight; in the boost 2 cm/s, but for the second after
    pitch-over.
    """
    ephemeris = flight_ephemeris(flight, 0.01)
    rng = np.random.default_rng(13)
    target = rng.integers(0, len(ephemeris), 100_000)
    share = rng.random(100_000)
    bend_s = flight.path.breakpoints_s()[target, 0]
    burnout_s = flight.burnout_s[target]
    impact_s = flight.impact_s[target]
    for start_s, bound_m_s in ((bend_s, 1.0), (bend_s + 1.0, 0.02)):
        times = start_s + share**2 * (burnout_s - start_s)
        gap = ephemeris.state(target, times)[1] - flight.path.state(target, times)[1]
        assert np.linalg.norm(gap, axis=1).max() < bound_m_s
    times = burnout_s + 0.5 + share * (impact_s - burnout_s - 1.0)
    start_m, end_m = (exact_m(flight, target, times + step) for step in (-0.5, 0.5))
    gap = ephemeris.state(target, times)[1] - (end_m - start_m)
    assert np.linalg.norm(gap, axis=1).max() < 1e-3


@pytest.mark.slow
@pytest.mark.parametrize(
    "forces", [Forces(), Forces(zonal=("j2", "j3"), drag=Drag(1500.0))], ids=["j2", "drag"]
)
def test_free_flight_under_forces_is_within_the_tolerance(forces):
    """Against propagation from burnout to each time, a thousand times as tight; to the aim point,
    through the air.
    """
    flight = drawn_aims(4, 17, 0.01, 0.0, forces=forces)
    coast = coast_ephemeris(flight, 0.01, forces)
    count = len(coast)
    target = np.repeat(np.arange(count), 40)
    share = np.tile([0.0, 1.0, *np.random.default_rng(18).random(38)], count)
    elapsed_s = share * (flight.impact_s - flight.burnout_s)[target]
    starts = flight.burnout_position_eci_m[target], flight.burnout_velocity_eci_m_s[target]
    exact, _ = propagate(*starts, elapsed_s, forces, tolerance_m=1e-5)
    time_s = flight.burnout_s[target] + elapsed_s
    time_s = np.clip(time_s, coast.start_s[target], coast.end_s[target])
    error = np.linalg.norm(coast.position_m(target, time_s) - eci_to_ecef(exact, time_s), axis=1)
    assert 1e-4 < error.max() <= 0.01
