"""Boosted flight: where it starts, that nothing jumps, and that a target flies as if it were
alone.
"""

import math

import numpy as np
import pytest
from hypothesis import given, strategies as st
from lone_rows import assert_rows_independent

from examples import examples
from opir_core.constants import EARTH_EQUATORIAL_RADIUS_M, EARTH_POLAR_RADIUS_M
from opir_core.flight import ascent, boost_path, boost_profile, boost_profiles, launch_site
from opir_core.flight.boost import vertical_climb_s
from opir_core.geometry import east_north_up_axes, ecef_to_geodetic, geodetic_to_ecef

PROFILES = tuple(boost_profiles().values())
EVERYONE = np.arange(len(PROFILES))


def a_path(
    latitude_rad=0.6,
    longitude_rad=-2.1,
    height_m=0.0,
    ignition_s=0.0,
    azimuth_rad=5.0,
    profiles=PROFILES,
):
    count = len(profiles)
    course = ascent(profiles, [profile.burnout_flight_path_angle_rad for profile in profiles])
    speed = np.array([profile.burnout_speed_m_s for profile in profiles])
    site = launch_site(np.broadcast_to(latitude_rad, (count,)), longitude_rad, height_m)
    return boost_path(
        site, ignition_s, np.broadcast_to(np.asarray(azimuth_rad, float), (count,)), speed, course
    )


def test_flight_starts_at_rest_at_the_launch_point():
    position, velocity = a_path(height_m=1234.0, ignition_s=17.0).state(
        EVERYONE, 17.0 + 0 * EVERYONE
    )
    launch_m = np.tile(geodetic_to_ecef(0.6, -2.1, 1234.0), (len(PROFILES), 1))
    assert position.tobytes() == launch_m.tobytes()
    assert not velocity.any()


def test_flight_rises_straight_up_before_pitch_over():
    path = a_path()
    position, velocity = path.state(
        EVERYONE, np.array([profile.pitch_start_s - 0.1 for profile in PROFILES])
    )
    east, north, up = east_north_up_axes(0.6, -2.1)
    for offset in (position - geodetic_to_ecef(0.6, -2.1, 0.0), velocity):
        assert (offset @ up > 10.0).all()
        np.testing.assert_allclose(offset @ np.stack([east, north], axis=1), 0.0, atol=1e-9)


def test_burnout_is_that_of_the_profile():
    path = a_path()
    position, velocity = path.state(EVERYONE, path.burnout_s)
    speed = np.linalg.norm(velocity, axis=1)
    np.testing.assert_allclose(
        speed, [profile.burnout_speed_m_s for profile in PROFILES], rtol=1e-14
    )
    centre = path.plane.launch_m - path.plane.radius_m[:, None] * path.plane.up
    radial = (position - centre) / np.linalg.norm(position - centre, axis=1)[:, None]
    angle = np.arcsin((velocity * radial).sum(axis=1) / speed)
    np.testing.assert_allclose(
        angle, [p.burnout_flight_path_angle_rad for p in PROFILES], rtol=1e-13
    )


def test_flight_heads_along_the_azimuth():
    for azimuth in (0.0, 1.0, 2.5, 4.0, 6.0):
        path = a_path(azimuth_rad=azimuth)
        position, _ = path.state(EVERYONE, path.burnout_s)
        east, north, _ = east_north_up_axes(0.6, -2.1)
        offset = position - geodetic_to_ecef(0.6, -2.1, 0.0)
        bearing = np.arctan2(offset @ east, offset @ north)
        np.testing.assert_allclose(
            np.remainder(bearing - azimuth + np.pi, 2 * np.pi), np.pi, atol=1e-12
        )


@pytest.mark.parametrize(
    ("latitude_rad", "azimuth_rad", "radius_m"),
    [
        (0.0, np.pi / 2, EARTH_EQUATORIAL_RADIUS_M),
        (0.0, 0.0, EARTH_POLAR_RADIUS_M**2 / EARTH_EQUATORIAL_RADIUS_M),
        (np.pi / 2, 0.3, EARTH_EQUATORIAL_RADIUS_M**2 / EARTH_POLAR_RADIUS_M),
        (-np.pi / 2, 2.0, EARTH_EQUATORIAL_RADIUS_M**2 / EARTH_POLAR_RADIUS_M),
    ],
)
def test_the_circle_of_the_launch_plane_osculates_the_ellipsoid(
    latitude_rad, azimuth_rad, radius_m
):
    assert a_path(latitude_rad, azimuth_rad=azimuth_rad).plane.radius_m == pytest.approx(
        radius_m, rel=1e-14
    )


def test_heights_are_above_the_ellipsoid_near_the_launch():
    """Over the first 10 km downrange sphere and ellipsoid part by less than 5 m."""
    path = a_path(height_m=500.0)
    times = np.array([60.0 if profile.name == "ICBM_liquid" else 30.0 for profile in PROFILES])
    position, _ = path.state(EVERYONE, times)
    rise = np.linalg.norm(
        position - (path.plane.launch_m - path.plane.radius_m[:, None] * path.plane.up), axis=1
    )
    np.testing.assert_allclose(
        ecef_to_geodetic(position).height_m, 500.0 + rise - path.plane.radius_m, atol=5.0
    )


def test_nothing_jumps_at_pitch_over():
    path = a_path()
    states = [path.state(EVERYONE, path.breakpoints_s()[:, 0] + step) for step in (-1e-9, 1e-9)]
    for start, end, tolerance in zip(*states, (1e-6, 0.01), strict=True):
        np.testing.assert_allclose(end, start, atol=tolerance)


@pytest.mark.parametrize("span", [(0.001, 0.999), (1e-6, 1e-3)])
def test_velocity_is_the_derivative_of_position(span):
    path = a_path()
    step = 1e-3
    for share in np.linspace(*span, 40):
        elapsed = np.array(
            [p.pitch_start_s + share * (p.burn_time_s - p.pitch_start_s) for p in PROFILES]
        )
        start, end = (path.state(EVERYONE, elapsed + h)[0] for h in (-step / 2, step / 2))
        _, velocity = path.state(EVERYONE, elapsed)
        kink = 60.0 * np.sqrt(step) if share < 1e-4 else 0.05
        np.testing.assert_allclose((end - start) / step, velocity, atol=kink)


@pytest.mark.parametrize("offset_s", [-0.001, 1e6, np.nan, np.inf])
def test_outside_the_burn_there_is_no_state(offset_s):
    path = a_path(ignition_s=100.0)
    assert np.isnan(path.state(EVERYONE, path.ignition_s + offset_s)).all()
    assert np.isnan(path.state(EVERYONE, path.burnout_s + 1e-6)).all()
    assert np.isfinite(path.state(EVERYONE, path.burnout_s)).all()


def test_boosts_do_not_depend_on_other_targets():
    times = np.linspace(0.0, 65.0, 301)

    def states(azimuth_rad, profiles):
        path = a_path(azimuth_rad=azimuth_rad, profiles=profiles)
        targets = np.arange(len(profiles))
        return np.stack([path.state(targets, 0 * targets + time) for time in times], axis=2)

    azimuth = np.arange(float(len(PROFILES)))
    rows = [slice(row, row + 1) for row in EVERYONE]
    assert_rows_independent(states, azimuth, np.array(PROFILES), rows=rows)
    path = a_path(azimuth_rad=azimuth)
    assert_rows_independent(lambda time_s: path.state(np.full(len(time_s), 2), time_s), times)


@pytest.mark.parametrize("shape", [1e-300, 1e-12, 1e-6, 1e-3, 0.5, 3.0, 30.0])
def test_vertical_climb_loses_nothing_for_any_shape(shape):
    """Against 50 digits, from nearly constant acceleration to nearly all of it at the end."""
    import mpmath

    for elapsed in (1e-6, 0.1, 5.0, 40.0, 100.0):
        with mpmath.workdps(700):
            y = mpmath.mpf(shape) * elapsed / 100
            expected = 100 * (mpmath.expm1(y) - y) / (mpmath.mpf(shape) * mpmath.expm1(shape))
        climb = vertical_climb_s(np.array([elapsed]), np.array([100.0]), np.array([shape]))
        assert climb[0] == pytest.approx(float(expected), rel=2e-14)


@examples(60)
@given(
    latitude=st.floats(-math.pi / 2, math.pi / 2),
    longitude=st.floats(-math.pi, math.pi),
    azimuth=st.floats(0.0, 2 * math.pi),
    burn_time=st.floats(10.0, 1000.0),
    profile=st.sampled_from(PROFILES),
)
def test_any_launch_climbs_all_the_way(latitude, longitude, azimuth, burn_time, profile):
    path = a_path(latitude, longitude, 0.0, 0.0, azimuth, (profile.with_burn_time(burn_time),))
    times = np.linspace(0.0, burn_time, 60)
    position, velocity = path.state(np.zeros(60, dtype=int), times)
    climb = np.diff(ecef_to_geodetic(position).height_m)
    assert (climb > 0.0).all()
    assert (np.diff(np.linalg.norm(velocity, axis=1)) > 0.0).all()


def test_profiles_of_one_name_and_burn_time_are_equal():
    assert boost_profile("SRBM").with_burn_time(65.0) == boost_profile("SRBM")
