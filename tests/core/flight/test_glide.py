"""Boost-glide flights: the closed forms of equilibrium glide, continuity, aim points, and
independence of targets.
"""

import math

import numpy as np
import pytest
from attrs import evolve
from lone_rows import assert_rows_independent

from opir_core.constants import EARTH_MU_M3_S2
from opir_core.flight import Drag, Forces
from opir_core.flight.glide import GlideShape, glide_ephemeris, glide_flight
from opir_core.geometry import Geodetic, ecef_to_geodetic, geodesic_direct, geodetic_to_ecef
from opir_core.scene import core_target_class

KIND = core_target_class("HGV")
(PROFILE,) = KIND.profiles
COUNT = 300


def shape_of(count, **changes):
    glide = evolve(KIND.after_burnout, **changes)
    return GlideShape(
        np.full(count, glide.lift_to_drag),
        np.full(count, glide.final_speed_m_s),
        np.full(count, glide.scale_height_m),
    )


def launches(count, seed):
    """Return places, aim points and times of launches from anywhere over any range."""
    rng = np.random.default_rng(seed)
    latitude = np.arcsin(rng.uniform(-1, 1, count))
    longitude = rng.uniform(-np.pi, np.pi, count)
    range_m = rng.uniform(1.0005 * PROFILE.minimum_range_m, 0.9995 * PROFILE.maximum_range_m, count)
    bearing = rng.uniform(0, 2 * np.pi, count)
    aims = geodesic_direct(latitude, longitude, bearing, range_m)
    ground = np.zeros(count)
    return (
        Geodetic(latitude, longitude, ground),
        Geodetic(*aims, ground),
        rng.uniform(0, 1e4, count),
    )


@pytest.fixture(scope="module")
def everywhere():
    """Flights from everywhere, in every direction, over the whole range of the profile."""
    return glide_flight(*launches(COUNT, 1), [PROFILE] * COUNT, shape_of(COUNT))


def level_speed_m_s(position, velocity):
    up = position / np.linalg.norm(position, axis=-1, keepdims=True)
    return np.linalg.norm(velocity - np.sum(velocity * up, axis=-1, keepdims=True) * up, axis=-1)


def test_every_aim_point_is_hit(everywhere):
    assert everywhere.converged.all()
    assert not any(everywhere.complaints)
    _, aims, _ = launches(COUNT, 1)
    assert np.linalg.norm(everywhere.impact_ecef_m - geodetic_to_ecef(*aims), axis=1).max() <= 0.01


def test_the_range_is_that_of_eggers_allen_and_neice(everywhere):
    """s = (E r/2) ln((1 - v_f²/v_c²)/(1 - v_0²/v_c²)), measured as the angle between the ends."""
    start = everywhere.burnout_position_ecef_m
    end = everywhere.release_position_ecef_m
    radius_m = np.linalg.norm(start, axis=1)
    speed_m_s = level_speed_m_s(start, everywhere.burnout_velocity_ecef_m_s)
    squared = EARTH_MU_M3_S2 / radius_m
    glide = KIND.after_burnout
    range_m = (
        0.5
        * glide.lift_to_drag
        * radius_m
        * np.log((1 - glide.final_speed_m_s**2 / squared) / (1 - speed_m_s**2 / squared))
    )
    cosine = np.sum(start * end, axis=1) / radius_m / np.linalg.norm(end, axis=1)
    np.testing.assert_allclose(radius_m * np.arccos(cosine), range_m, rtol=1e-9)
    assert range_m.max() > 5e6


def test_the_glide_ends_at_the_final_speed(everywhere):
    """The speed along the ground scales with the radius, which the closed form holds constant."""
    end = everywhere.release_position_ecef_m
    speed_m_s = level_speed_m_s(end, everywhere.release_velocity_ecef_m_s)
    scale = np.linalg.norm(end, axis=1) / np.linalg.norm(everywhere.burnout_position_ecef_m, axis=1)
    np.testing.assert_allclose(speed_m_s / scale, KIND.after_burnout.final_speed_m_s, rtol=1e-9)
    assert np.abs(scale - 1.0).max() < 0.01


def test_the_duration_of_the_glide_is_that_of_constant_drag(everywhere):
    """t = (E v_c/2g) ln((1 + v_0/v_c)(1 - v_f/v_c)/((1 - v_0/v_c)(1 + v_f/v_c)))."""
    position = everywhere.burnout_position_ecef_m
    radius_m = np.linalg.norm(position, axis=1)
    circular = np.sqrt(EARTH_MU_M3_S2 / radius_m)
    start = level_speed_m_s(position, everywhere.burnout_velocity_ecef_m_s) / circular
    end = 1500.0 / circular
    scale_s = 0.5 * KIND.after_burnout.lift_to_drag * circular * radius_m**2 / EARTH_MU_M3_S2
    expected_s = scale_s * np.log((1 + start) * (1 - end) / ((1 - start) * (1 + end)))
    np.testing.assert_allclose(everywhere.release_s - everywhere.burnout_s, expected_s, rtol=1e-12)


def test_lift_equals_weight_less_centrifugal_force(everywhere):
    """rho v²/(1 - v²/v_c²) is constant: with density exp(-h/H), h falls by H ln of the ratio."""
    share = np.linspace(0.0, 1.0, 21)[:, None]
    since_s = share * (everywhere.release_s - everywhere.burnout_s)
    target = np.tile(np.arange(COUNT), 21)
    position, velocity = everywhere.state(target, (everywhere.burnout_s + since_s).ravel())
    radius_m = np.linalg.norm(everywhere.burnout_position_ecef_m, axis=1)[target]
    speed_m_s = level_speed_m_s(position, velocity) * radius_m / np.linalg.norm(position, axis=1)
    squared = speed_m_s**2 * radius_m / EARTH_MU_M3_S2
    height_m = ecef_to_geodetic(position).height_m
    lift = (
        squared / (1.0 - squared) * np.exp(-height_m / KIND.after_burnout.scale_height_m)
    ).reshape(21, COUNT)
    # The height is along the geocentric direction, up to a third of a degree from the normal: 0.6 m
    # at 60 km.
    np.testing.assert_allclose(lift, np.broadcast_to(lift[0], lift.shape), rtol=2e-4)


def test_states_do_not_jump_at_burnout_and_release(everywhere):
    everyone = np.arange(COUNT)
    boost = everywhere.path.state(everyone, everywhere.burnout_s)
    glide = everywhere.state(everyone, everywhere.burnout_s)
    np.testing.assert_allclose(np.array(glide), np.array(boost), atol=1e-6)
    ephemeris = glide_ephemeris(everywhere)
    states = [ephemeris.state(everyone, everywhere.release_s + step) for step in (-1e-3, 1e-3)]
    for start, end, tolerance in zip(*states, (4.0, 0.1), strict=True):
        np.testing.assert_allclose(end, start, atol=tolerance)


@pytest.mark.parametrize("share", [0.01, 0.5, 0.99])
def test_velocity_is_the_derivative_of_position(everywhere, share):
    everyone = np.arange(COUNT)
    time_s = everywhere.burnout_s + share * (everywhere.release_s - everywhere.burnout_s)
    start, end = (everywhere.state(everyone, time_s + step)[0] for step in (-0.05, 0.05))
    velocity = everywhere.state(everyone, time_s)[1]
    np.testing.assert_allclose((end - start) / 0.1, velocity, atol=1e-3)


def test_the_ephemeris_goes_from_burnout_to_impact(everywhere):
    ephemeris = glide_ephemeris(everywhere)
    everyone = np.arange(COUNT)
    np.testing.assert_allclose(
        ephemeris.position_m(everyone, everywhere.burnout_s),
        everywhere.burnout_position_ecef_m,
        atol=1e-5,
    )
    np.testing.assert_allclose(
        ephemeris.position_m(everyone, everywhere.impact_s), everywhere.impact_ecef_m, atol=1e-5
    )
    middle_s = 0.5 * (everywhere.burnout_s + everywhere.release_s)
    error = ephemeris.position_m(everyone, middle_s) - everywhere.state(everyone, middle_s)[0]
    assert np.linalg.norm(error, axis=1).max() <= 0.01


def test_heights_fall_and_stay_in_the_air(everywhere):
    everyone = np.arange(COUNT)
    times_s = np.linspace(everywhere.burnout_s, everywhere.release_s, 15)
    heights_m = np.array(
        [ecef_to_geodetic(everywhere.state(everyone, time_s)[0]).height_m for time_s in times_s]
    )
    assert (np.diff(heights_m, axis=0) < 0.0).all()
    assert (ecef_to_geodetic(everywhere.burnout_position_ecef_m).height_m < 70e3).all()
    assert (heights_m[-1] > 15e3).all()


def one_flight(latitude_rad, bearing_rad, range_m):
    start = Geodetic(np.array([latitude_rad]), np.zeros(1), np.zeros(1))
    end = geodesic_direct(start.latitude_rad, 0.0, bearing_rad, range_m)
    aim = Geodetic(*end, np.zeros(1))
    return glide_flight(start, aim, np.zeros(1), [PROFILE], shape_of(1))


def test_the_reference_range_takes_the_reference_burnout_speed():
    """Launched at the pole; sphere and ellipsoid differ by a quarter of a percent in speed."""
    flight = one_flight(0.5 * math.pi, 0.0, PROFILE.reference_range_m)
    assert flight.burnout_speed_m_s[0] == pytest.approx(PROFILE.burnout_speed_m_s, rel=0.003)
    assert flight.burnout_s[0] == PROFILE.burn_time_s


@pytest.mark.slow
@pytest.mark.parametrize(
    "forces", [Forces(zonal=("j2",)), Forces(zonal=("j2",), drag=Drag(3000.0))], ids=["j2", "drag"]
)
def test_aim_points_are_hit_under_forces_after_the_glide(forces):
    flight = glide_flight(*launches(12, 3), [PROFILE] * 12, shape_of(12), forces=forces)
    assert flight.converged.all()
    plain = glide_flight(*launches(12, 3), [PROFILE] * 12, shape_of(12))
    assert np.abs(flight.burnout_speed_m_s - plain.burnout_speed_m_s).max() > 1e-3
    ephemeris = glide_ephemeris(flight, 0.01, forces)
    np.testing.assert_allclose(
        ephemeris.position_m(np.arange(12), flight.impact_s), flight.impact_ecef_m, atol=0.02
    )


def test_a_flight_is_the_same_alone_and_among_others():
    def results(latitude, longitude, height_m, *aims_and_time):
        *aims, ignition_s = aims_and_time
        count = len(latitude)
        place = Geodetic(latitude, longitude, height_m)
        flight = glide_flight(
            place, Geodetic(*aims), ignition_s, [PROFILE] * count, shape_of(count)
        )
        return flight.burnout_velocity_ecef_m_s, flight.impact_s

    place, aims, ignition_s = launches(COUNT, 1)
    rows = [slice(row, row + 1) for row in (0, 17, 299)]
    assert_rows_independent(results, *place, *aims, ignition_s, rows=rows)


@pytest.mark.parametrize("range_m", [1.5e6, 9e6])
def test_ranges_beyond_the_limits_are_refused(range_m):
    flight = one_flight(0.3, 1.0, range_m)
    assert not flight.converged.any()
    assert "HGV flies 2000 to 8000 km" in flight.complaints[0]


def test_a_glide_that_would_end_underground_is_refused():
    """With a scale height of 30 km the air is so thick below that the glide ends beneath the
    ground.
    """
    flight = glide_flight(*launches(3, 4), [PROFILE] * 3, shape_of(3, scale_height_m=30e3))
    assert not flight.converged.any()
    assert "no flight of HGV was found" in flight.complaints[0]
