"""Boosted flight: where it starts, that nothing jumps, and that a target flies as if it were
alone.
"""

import math

import numpy as np
import pytest
from hypothesis import given, strategies as st

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
    path = a_path(height_m=1234.0, ignition_s=17.0)
    position, velocity = path.state(EVERYONE, np.full(len(PROFILES), 17.0))
    assert (
        position.tobytes()
        == np.tile(geodetic_to_ecef(0.6, -2.1, 1234.0), (len(PROFILES), 1)).tobytes()
    )
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


def test_burnout_has_the_speed_and_the_flight_path_angle_of_the_profile():
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


def test_height_of_the_path_is_height_above_the_ellipsoid_near_the_launch():
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
    pitch_over = np.array([profile.pitch_start_s for profile in PROFILES])
    before, after = (path.state(EVERYONE, pitch_over + step) for step in (-1e-9, 1e-9))
    np.testing.assert_allclose(after[0], before[0], atol=1e-6)
    np.testing.assert_allclose(after[1], before[1], atol=0.01)


@pytest.mark.parametrize("span", [(0.001, 0.999), (1e-6, 1e-3)])
def test_velocity_is_the_derivative_of_position(span):
    path = a_path()
    step = 1e-3
    for share in np.linspace(*span, 40):
        elapsed = np.array(
            [p.pitch_start_s + share * (p.burn_time_s - p.pitch_start_s) for p in PROFILES]
        )
        (ahead, _), (behind, _) = (path.state(EVERYONE, elapsed + h) for h in (step / 2, -step / 2))
        _, velocity = path.state(EVERYONE, elapsed)
        kink = 60.0 * np.sqrt(step) if share < 1e-4 else 0.05
        np.testing.assert_allclose((ahead - behind) / step, velocity, atol=kink)


def test_outside_the_burn_there_is_no_state():
    path = a_path(ignition_s=100.0)
    for times in (
        np.full(len(PROFILES), 99.999),
        path.burnout_s + 1e-6,
        np.full(len(PROFILES), np.nan),
        np.full(len(PROFILES), np.inf),
    ):
        position, velocity = path.state(EVERYONE, times)
        assert np.isnan(position).all()
        assert np.isnan(velocity).all()
    assert np.isfinite(path.state(EVERYONE, path.burnout_s)[0]).all()


def test_a_target_flies_as_if_alone():
    together = a_path(azimuth_rad=np.arange(float(len(PROFILES))))
    times = np.linspace(0.0, 65.0, 301)
    for row, profile in enumerate(PROFILES):
        alone = a_path(azimuth_rad=float(row), profiles=(profile,))
        mine = together.state(np.full(301, row), times)
        his = alone.state(np.zeros(301, dtype=int), times)
        single = [alone.state(np.zeros(1, dtype=int), times[k : k + 1])[0][0] for k in (0, 17, 300)]
        assert mine[0].tobytes() == his[0].tobytes()
        assert mine[1].tobytes() == his[1].tobytes()
        assert np.array(single).tobytes() == his[0][[0, 17, 300]].tobytes()


@pytest.mark.parametrize("shape", [1e-300, 1e-12, 1e-6, 1e-3, 0.5, 3.0, 30.0])
def test_vertical_climb_loses_nothing_for_any_shape(shape):
    """Against 50 digits, from nearly constant acceleration to nearly all of it at the end."""
    import mpmath

    for elapsed in (1e-6, 0.1, 5.0, 40.0, 100.0):
        with mpmath.workdps(700):
            y = mpmath.mpf(shape) * elapsed / 100
            expected = 100 * (mpmath.expm1(y) - y) / (mpmath.mpf(shape) * mpmath.expm1(shape))
        found = vertical_climb_s(np.array([elapsed]), np.array([100.0]), np.array([shape]))
        assert found[0] == pytest.approx(float(expected), rel=2e-14)


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


def test_profiles_of_one_name_and_burn_time_are_one():
    assert boost_profile("SRBM").with_burn_time(65.0) == boost_profile("SRBM")
