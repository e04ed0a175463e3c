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


@pytest.fixture(scope="module")
def flight():
    rng = np.random.default_rng(11)
    profiles = [profile for profile in boost_profiles().values() for _ in range(EACH)]
    latitude = np.arcsin(rng.uniform(-1, 1, len(profiles)))
    longitude = rng.uniform(-np.pi, np.pi, len(profiles))
    range_m = np.array(
        [rng.uniform(1.001 * p.minimum_range_m, 0.999 * p.maximum_range_m) for p in profiles]
    )
    there = geodesic_direct(latitude, longitude, rng.uniform(0, 2 * np.pi, len(profiles)), range_m)
    ignition_s = rng.uniform(0.0, 1e5, len(profiles))
    found = aim(Geodetic(latitude, longitude, 0.0), Geodetic(*there, 0.0), ignition_s, profiles)
    assert found.converged.all()
    return found


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
        *(pytest.param(each, 1_000_000, marks=pytest.mark.slow) for each in (1.0, 0.01, 1e-4)),
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
    bend_s = path.breakpoints_s()[target, 0]
    burnout_s = path.burnout_s[target]
    impact_s = flight.impact_s[target]
    anywhere = path.ignition_s[target] + share * (burnout_s - path.ignition_s[target])
    choices = [
        anywhere,
        bend_s + crowded * (burnout_s - bend_s),
        burnout_s + share * (impact_s - burnout_s),
    ]
    times = np.select([np.arange(points) % 3 == k for k in range(3)], choices)
    everyone = np.arange(len(ephemeris))
    target = np.concatenate([target, everyone, everyone, everyone])
    times = np.concatenate([times, path.ignition_s, path.burnout_s, ephemeris.end_s])
    error = np.linalg.norm(
        ephemeris.position_m(target, times) - exact_m(flight, target, times), axis=1
    )
    assert 0.1 * tolerance_m < error.max() <= tolerance_m


def test_flights_go_from_launch_to_impact_without_a_jump(flight):
    ephemeris = flight_ephemeris(flight, 0.01)
    everyone = np.arange(len(boost_profiles()) * EACH)
    assert ephemeris.start_s.tobytes() == flight.path.ignition_s.tobytes()
    assert ephemeris.end_s.tobytes() == flight.impact_s.tobytes()
    ends = [ephemeris.position_m(everyone, times) for times in (ephemeris.start_s, ephemeris.end_s)]
    np.testing.assert_allclose(ends[0], flight.path.plane.launch_m, atol=1e-6)
    np.testing.assert_allclose(ends[1], flight.impact_ecef_m, atol=1e-5)
    boost = boost_ephemeris(flight.path)
    coast = coast_ephemeris(flight)
    for before, after in zip(
        boost.state(everyone, boost.end_s), coast.state(everyone, coast.start_s), strict=True
    ):
        np.testing.assert_allclose(after, before, atol=1e-5)


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
    for start_s, bound_m_s in ((bend_s, 1.0), (bend_s + 1.0, 0.02)):
        times = start_s + share**2 * (burnout_s - start_s)
        gap = ephemeris.state(target, times)[1] - flight.path.state(target, times)[1]
        assert np.linalg.norm(gap, axis=1).max() < bound_m_s
    times = burnout_s + share * (flight.impact_s[target] - burnout_s)
    step = 0.5 * (exact_m(flight, target, times + 0.5) - exact_m(flight, target, times - 0.5)) / 0.5
    inside = (times > burnout_s + 0.5) & (times < flight.impact_s[target] - 0.5)
    gap = (ephemeris.state(target, times)[1] - step)[inside]
    assert np.linalg.norm(gap, axis=1).max() < 1e-3


@pytest.mark.slow
@pytest.mark.parametrize(
    "forces", [Forces(), Forces(zonal=("j2", "j3"), drag=Drag(1500.0))], ids=["j2", "drag"]
)
def test_free_flight_under_forces_is_within_the_tolerance(forces):
    """Against propagation from burnout to each time, a thousand times as tight; to the aim point,
    through the air.
    """
    rng = np.random.default_rng(17)
    profiles = [profile for profile in boost_profiles().values() for _ in range(4)]
    latitude = np.arcsin(rng.uniform(-1, 1, len(profiles)))
    longitude = rng.uniform(-np.pi, np.pi, len(profiles))
    range_m = np.array(
        [rng.uniform(1.01 * p.minimum_range_m, 0.99 * p.maximum_range_m) for p in profiles]
    )
    there = geodesic_direct(latitude, longitude, rng.uniform(0, 2 * np.pi, len(profiles)), range_m)
    flight = aim(
        Geodetic(latitude, longitude, 0.0), Geodetic(*there, 0.0), 0.0, profiles, forces=forces
    )
    assert flight.converged.all()
    coast = coast_ephemeris(flight, 0.01, forces)
    target = np.repeat(np.arange(len(profiles)), 40)
    share = np.concatenate([[0.0, 1.0], rng.random(38)])[np.arange(len(target)) % 40]
    elapsed_s = share * (flight.impact_s - flight.burnout_s)[target]
    starts = flight.burnout_position_eci_m[target], flight.burnout_velocity_eci_m_s[target]
    exact, _ = propagate(*starts, elapsed_s, forces, tolerance_m=1e-5)
    time_s = np.clip(
        flight.burnout_s[target] + elapsed_s, coast.start_s[target], coast.end_s[target]
    )
    error = np.linalg.norm(coast.position_m(target, time_s) - eci_to_ecef(exact, time_s), axis=1)
    assert error.max() <= 0.01
    assert error.max() > 1e-4
