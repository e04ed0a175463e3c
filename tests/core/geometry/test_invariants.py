"""What holds for geometry everywhere: round trips, the Earth's symmetry about its axis, units of a
turning frame.
"""

import numpy as np
from hypothesis import example, given, strategies as st

from opir_core.constants import EARTH_ROTATION_RAD_S
from opir_core.geometry import (
    azimuth_elevation_range,
    azimuth_elevation_range_in_axes,
    east_north_up_axes,
    ecef_to_eci,
    ecef_to_eci_state,
    ecef_to_geodetic,
    eci_to_ecef,
    eci_to_ecef_state,
    elevation_rad,
    geodetic_to_ecef,
    grazing_height_m,
    intersection_with_ellipsoid,
    is_occluded,
    is_sunlit,
    line_of_sight,
    local_axes,
    nadir_angle_rad,
    sunlit_fraction,
)

latitudes = st.one_of(
    st.floats(-np.pi / 2, np.pi / 2), st.sampled_from([0.0, -0.0, np.pi / 2, -np.pi / 2, 1e-300])
)
longitudes = st.one_of(
    st.floats(-np.pi, np.pi),
    st.sampled_from([0.0, np.pi, -np.pi, np.pi / 2, np.nextafter(np.pi, 0)]),
)
heights = st.one_of(
    st.floats(-5e3, 1e6), st.floats(1e6, 4e8), st.sampled_from([0.0, -0.0, 3.5786e7])
)
places = st.tuples(latitudes, longitudes, heights)
azimuths = st.one_of(
    st.floats(0.0, 2 * np.pi, exclude_max=True),
    st.sampled_from([0.0, 1e-300, np.nextafter(2 * np.pi, 0)]),
)
elevations = st.one_of(
    st.floats(-np.pi / 2, np.pi / 2), st.sampled_from([np.pi / 2, -np.pi / 2, 0.0])
)
times = st.one_of(
    st.floats(-3e6, 3e6), st.sampled_from([0.0, 1e-9, 2.0 * np.pi / EARTH_ROTATION_RAD_S])
)
coordinates = st.one_of(
    st.floats(-5e8, 5e8), st.sampled_from([0.0, -0.0, 1e-300, 42697.672707157535, 6378137.0])
)
positions = st.tuples(coordinates, coordinates, coordinates).map(np.array)


def length(vector):
    return float(np.sqrt(np.sum(np.square(vector))))


def spun(vector, angle):
    x, y, z = np.moveaxis(np.asarray(vector), -1, 0)
    return np.stack(
        [np.cos(angle) * x - np.sin(angle) * y, np.sin(angle) * x + np.cos(angle) * y, z], axis=-1
    )


@given(positions)
def test_position_to_geodetic_and_back(position):
    latitude, longitude, height = ecef_to_geodetic(position)
    assert abs(latitude) <= np.pi / 2
    assert abs(longitude) <= np.pi
    assert length(
        geodetic_to_ecef(latitude, longitude, height) - position
    ) <= 6e-9 + 6e-16 * length(position)


@given(places)
def test_geodetic_to_position_and_back(place):
    latitude, longitude, height = place
    restored = ecef_to_geodetic(geodetic_to_ecef(latitude, longitude, height))
    rounding = 6e-16 + 1e-9 / (6.3e6 + height)
    assert abs(restored.latitude_rad - latitude) <= rounding
    assert abs(np.sin(restored.longitude_rad - longitude)) * np.cos(latitude) <= rounding
    assert abs(restored.height_m - height) <= 3e-9 + 6e-16 * abs(height)


@given(positions, st.floats(-10.0, 10.0))
def test_geodetic_is_symmetric_about_the_axis_and_the_equator(position, angle):
    geodetic = ecef_to_geodetic(position)
    turned = ecef_to_geodetic(spun(position, angle))
    mirrored = ecef_to_geodetic(position * [1.0, 1.0, -1.0])
    assert abs(turned.height_m - geodetic.height_m) <= 6e-9 + 1e-15 * length(position)
    assert mirrored.height_m == geodetic.height_m
    if position[2] != 0.0:
        assert mirrored.latitude_rad == -geodetic.latitude_rad
    assert mirrored.longitude_rad == geodetic.longitude_rad


@given(positions, times)
def test_inertial_frame_and_back(position, time):
    inertial = ecef_to_eci(position, time)
    assert length(eci_to_ecef(inertial, time) - position) <= 6e-16 * length(position)
    assert inertial[2] == position[2]
    assert length(ecef_to_eci(position, 0.0) - position) == 0.0


@given(positions, positions.map(lambda p: p * 1e-5), times)
def test_inertial_state_and_back(position, velocity, time):
    back_position, back_velocity = eci_to_ecef_state(
        *ecef_to_eci_state(position, velocity, time), time
    )
    assert length(back_position - position) <= 6e-16 * length(position)
    assert length(back_velocity - velocity) <= 1e-15 * (
        length(velocity) + EARTH_ROTATION_RAD_S * length(position)
    )


@given(positions, positions.map(lambda p: p * 1e-5), st.floats(-1e4, 1e4))
def test_inertial_velocity_is_the_change_of_inertial_position(position, velocity, time):
    step = 0.5
    _, inertial = ecef_to_eci_state(position, velocity, time)
    end, start = (ecef_to_eci(position + velocity * s, time + s) for s in (step, -step))
    curvature = EARTH_ROTATION_RAD_S**2 * (
        length(velocity) + EARTH_ROTATION_RAD_S * length(position)
    )
    assert (
        length((end - start) / (2 * step) - inertial)
        <= step**2 * curvature + 4e-15 * length(position) + 1e-12
    )


@given(places, azimuths, elevations, st.floats(1.0, 4e8))
def test_line_of_sight_undoes_azimuth_and_elevation(place, azimuth, elevation, distance):
    observer = geodetic_to_ecef(*place)
    ray = line_of_sight(observer, azimuth, elevation)
    assert abs(length(ray) - 1.0) <= 6e-16
    look = azimuth_elevation_range(observer, observer + distance * ray)
    rounding = 2e-15 + 4e-16 * length(observer) / distance
    assert abs(look.elevation_rad - elevation) <= rounding
    assert abs(np.sin(look.azimuth_rad - azimuth)) * np.cos(elevation) <= rounding
    assert abs(look.range_m - distance) <= 6e-16 * (length(observer) + distance)
    assert 0.0 <= look.azimuth_rad < 2.0 * np.pi


@given(positions, positions, st.floats(-10.0, 10.0))
def test_looks_are_symmetric_about_the_axis(observer, target, angle):
    # On the axis longitude is a convention, and near the centre the vertical is ill-conditioned.
    if np.hypot(observer[0], observer[1]) < 1e6 or length(target - observer) < 1e3:
        return
    look = azimuth_elevation_range(observer, target)
    turned = azimuth_elevation_range(spun(observer, angle), spun(target, angle))
    rounding = (
        3e-15 * (length(observer) + length(target)) * (1 / length(target - observer) + 1 / 1e6)
    )
    assert abs(turned.elevation_rad - look.elevation_rad) <= 1e-15 + rounding
    assert (
        abs(np.sin(turned.azimuth_rad - look.azimuth_rad)) * np.cos(look.elevation_rad)
        <= 1e-15 + rounding
    )
    assert abs(turned.range_m - look.range_m) <= 1e-15 * (length(observer) + length(target))
    assert elevation_rad(observer, target) == look.elevation_rad
    assert azimuth_elevation_range_in_axes(target - observer, local_axes(observer)) == look


@given(places)
def test_local_axes_by_position_and_by_angles_are_the_same(place):
    position = geodetic_to_ecef(*place)
    latitude, longitude, _ = ecef_to_geodetic(position)
    assert np.max(np.abs(local_axes(position) - east_north_up_axes(latitude, longitude))) <= 1e-15


@given(places, places)
def test_nadir_angle_and_angle_at_the_target_close_the_triangle(sensor_place, target_place):
    sensor = geodetic_to_ecef(*sensor_place)
    target = geodetic_to_ecef(*target_place)
    if length(target - sensor) < 1e5:
        return
    central = np.arctan2(length(np.cross(sensor, target)), np.sum(sensor * target))
    total = nadir_angle_rad(sensor, target) + nadir_angle_rad(target, sensor) + central
    assert abs(total - np.pi) <= 1e-12


@given(positions, positions, st.floats(-10.0, 10.0))
@example(np.array([0.0, 7.9e-217, 1.0]), np.array([-33013.0, 0.0, 0.0]), 1.0)
@example(np.array([0.0, 0.0, 0.0]), np.array([0.0, 1.0, -1.2e-220]), 0.0)
def test_grazing_height_is_symmetric_and_never_above_the_ends(observer, target, angle):
    height = grazing_height_m(observer, target)
    reach = length(observer) + length(target)
    assert abs(grazing_height_m(target, observer) - height) <= 1e-8 + 1e-15 * reach
    assert (
        abs(grazing_height_m(spun(observer, angle), spun(target, angle)) - height)
        <= 1e-8 + 3e-15 * reach
    )
    ends = ecef_to_geodetic(np.stack([observer, target])).height_m
    assert height <= np.min(ends) + 3e-9 + 1e-15 * reach
    assert is_occluded(observer, target) == is_occluded(target, observer)


@given(positions, positions, st.floats(-2e6, 1e5))
@example(np.array([4.2e7, 0.0, 0.0]), np.array([-4.2e7, 1e3, 0.0]), -1e5)
@example(np.array([4.2e7, 0.0, 0.0]), np.array([0.0, 6.37e6, 0.0]), -10.0)
def test_inexact_grazing_heights_are_bounds_below_the_limit(observer, target, limit_m):
    exact, quick = (
        grazing_height_m(observer, target, exact_above_m=limit) for limit in (-np.inf, limit_m)
    )
    assert quick == exact or exact - 1e-8 <= quick < limit_m


@given(places, azimuths, st.floats(-np.pi / 2, -1e-3))
def test_what_a_ray_meets_is_in_view_and_what_lies_behind_is_not(place, azimuth, elevation):
    latitude, longitude, height = place
    observer = geodetic_to_ecef(latitude, longitude, abs(height) + 1.0)
    ray = line_of_sight(observer, azimuth, elevation)
    met = intersection_with_ellipsoid(observer, ray)
    if np.isnan(met[0]):
        assert not is_occluded(observer, observer + 1e9 * ray)
        return
    assert abs(ecef_to_geodetic(met).height_m) <= 1e-8 + 1e-15 * height
    sine = abs(np.sin(elevation_rad(met, observer)))
    if sine > 1e-3:
        assert not is_occluded(observer, met - ray)
        assert is_occluded(observer, met + 1e8 * ray)
        assert grazing_height_m(observer, met + 1e8 * ray) < 0.0


@given(positions, st.floats(0.0, 2 * np.pi), st.floats(-0.41, 0.41), st.floats(-10.0, 10.0))
@example(np.array([0.0, 6378137.0, 0.0]), 0.0, 0.0, 9.99609375)
def test_sunlight_is_a_share_and_symmetric_about_the_axis(
    position, right_ascension, declination, angle
):
    sun = 1.496e11 * np.array(
        [
            np.cos(right_ascension) * np.cos(declination),
            np.sin(right_ascension) * np.cos(declination),
            np.sin(declination),
        ]
    )
    if length(position) < 6.3e6:
        return
    share = sunlit_fraction(position, sun)
    assert 0.0 <= share <= 1.0
    assert is_sunlit(position, sun) == (share > 0.0)
    # At the ground the horizon dips with the root of height: 3e-9 m of rounding is 3e-8 rad of a
    # disc of 9e-3 rad.
    rounding = 1e-5 if length(position) < 6.4e6 else 1e-8
    assert abs(sunlit_fraction(spun(position, angle), spun(sun, angle)) - share) <= rounding
    if np.sum(position * sun) > 0.01 * length(position) * length(sun):
        assert share == 1.0
