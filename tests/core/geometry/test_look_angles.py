"""Looks where conventions bite: straight up and down, north and south, poles, the same place; and
light and shade.
"""

import numpy as np
import pytest

from opir_core.constants import (
    EARTH_EQUATORIAL_RADIUS_M,
    EARTH_POLAR_RADIUS_M,
    GEOSTATIONARY_RADIUS_M,
)
from opir_core.geometry import (
    azimuth_elevation_range,
    east_north_up_axes,
    ecef_to_geodetic,
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

SLOT = np.array([GEOSTATIONARY_RADIUS_M, 0.0, 0.0])
SUN = np.array([1.496e11, 0.0, 0.0])


def test_a_sensor_looks_down_at_minus_ninety_degrees():
    for latitude in np.radians([-90.0, -40.0, 0.0, 10.0, 89.999]):
        sensor = geodetic_to_ecef(latitude, 0.7, 8e5)
        below = geodetic_to_ecef(latitude, 0.7, 0.0)
        assert elevation_rad(sensor, below) == pytest.approx(-np.pi / 2, abs=1e-13)
        assert elevation_rad(below, sensor) == pytest.approx(np.pi / 2, abs=1e-13)


def test_azimuth_runs_clockwise_from_north():
    observer = geodetic_to_ecef(0.5, 1.0, 0.0)
    for azimuth, (north, east) in {0.0: (1, 0), 0.5: (0, 1), 1.0: (-1, 0), 1.5: (0, -1)}.items():
        target = geodetic_to_ecef(0.5 + 1e-6 * north, 1.0 + 1e-6 * east, 0.0)
        assert azimuth_elevation_range(observer, target).azimuth_rad == pytest.approx(
            azimuth * np.pi, abs=1e-6
        )


def test_due_north_is_zero_and_never_a_full_turn():
    observer = np.array([EARTH_EQUATORIAL_RADIUS_M, 0.0, 0.0])
    for west in (0.0, -0.0, -5e-324, -1e-300, -1e-12, -1e-9, -4e-10):
        azimuth = azimuth_elevation_range(
            observer, observer + np.array([0.0, west, 1e6])
        ).azimuth_rad
        assert 0.0 <= azimuth < 2.0 * np.pi
        assert not np.signbit(azimuth)


def test_exactly_below_azimuth_is_zero():
    azimuth, elevation, distance = azimuth_elevation_range(SLOT, [6378137.0, 0.0, 0.0])
    assert (azimuth, elevation) == (0.0, -np.pi / 2)
    assert distance == GEOSTATIONARY_RADIUS_M - 6378137.0
    assert azimuth_elevation_range([0.0, 0.0, 9e6], [0.0, 0.0, 7e6])[:2] == (0.0, -np.pi / 2)


def test_on_the_axis_longitude_counts_as_zero():
    north_pole = np.array([0.0, 0.0, EARTH_POLAR_RADIUS_M])
    # At the pole north points to where longitude is 180 degrees, east to 90.
    assert azimuth_elevation_range(north_pole, [-1e6, 0.0, EARTH_POLAR_RADIUS_M])[:2] == (0.0, 0.0)
    assert (
        azimuth_elevation_range(north_pole, [0.0, 1e6, EARTH_POLAR_RADIUS_M]).azimuth_rad
        == np.pi / 2
    )
    assert line_of_sight(north_pole, np.pi / 2, 0.0) == pytest.approx([0.0, 1.0, 0.0], abs=1e-15)


def test_the_sign_of_a_zero_moves_no_longitude():
    for y in (0.0, -0.0):
        assert ecef_to_geodetic([-7e6, y, 1e6]).longitude_rad == np.pi
        assert ecef_to_geodetic([-0.0, y, 7e6]).longitude_rad == 0.0


def test_local_axes_hold_down_to_the_centre():
    """Where the foot is found by bisection, the normal is as sharp as the latitude."""
    directions = np.random.default_rng(4).normal(size=(500, 3))
    for scale in (1.0, 1e3, 3e4, 3e5):
        latitude, longitude, _ = ecef_to_geodetic(scale * directions)
        by_angles = east_north_up_axes(latitude, longitude)
        assert np.max(np.abs(local_axes(scale * directions) - by_angles)) < 1e-14


def test_the_same_place_has_a_range_and_no_direction():
    azimuth, elevation, distance = azimuth_elevation_range(SLOT, SLOT)
    assert np.isnan(azimuth)
    assert np.isnan(elevation)
    assert distance == 0.0
    assert np.isnan(elevation_rad(SLOT, SLOT))
    assert np.isnan(nadir_angle_rad(SLOT, SLOT))
    assert np.isnan(nadir_angle_rad([0.0, 0.0, 0.0], SLOT))


def test_nadir_angle_ends():
    assert nadir_angle_rad(SLOT, [0.0, 0.0, 0.0]) == 0.0
    assert nadir_angle_rad(SLOT, 2.0 * SLOT) == np.pi
    limb = nadir_angle_rad(
        SLOT, [EARTH_EQUATORIAL_RADIUS_M**2 / GEOSTATIONARY_RADIUS_M, 6304791.0, 0.0]
    )
    assert np.degrees(limb) == pytest.approx(8.7, abs=0.01)


@pytest.mark.slow
@pytest.mark.parametrize(
    ("lowest", "highest", "bound"),
    [
        (1e1, 1e5, 1e-8),
        (1e3, 6.3e6, 1e-8),
        (3e6, 8e6, 1e-8),
        (6.38e6, 7e6, 1e-8),
        (6.4e6, 4.3e7, 5e-8),
    ],
)
def test_least_height_against_a_search_along_the_segment(lowest, highest, bound):
    """Narrowed to the neighbours of the least of 21 heights, again and again: signed distance to a
    convex body has one minimum on a line.
    """
    ends = np.random.default_rng(1).normal(size=(2, 250, 3))
    radius = np.random.default_rng(2).uniform(lowest, highest, (2, 250, 1))
    observer, target = ends * radius / np.linalg.norm(ends, axis=2, keepdims=True)
    grid = np.linspace(0.0, 1.0, 21)
    low = np.zeros((250, 1))
    high = np.ones((250, 1))
    for _ in range(14):
        shares = low + (high - low) * grid
        points = observer[:, None] + shares[..., None] * (target - observer)[:, None]
        heights = ecef_to_geodetic(points).height_m
        least = heights.argmin(axis=1)[:, None]
        low, high = (
            np.take_along_axis(shares, np.clip(least + step, 0, 20), axis=1) for step in (-1, 1)
        )
    assert np.max(np.abs(grazing_height_m(observer, target) - heights.min(axis=1))) < bound


def test_least_height_through_the_middle_of_the_earth():
    a = EARTH_EQUATORIAL_RADIUS_M
    b = EARTH_POLAR_RADIUS_M
    assert grazing_height_m([0, 0, 9e6], [0, 0, -9e6]) == pytest.approx(-b, rel=0.0, abs=1e-8)
    assert grazing_height_m([9e6, 0, 0], [-9e6, 0, 0]) == pytest.approx(-b, rel=0.0, abs=1e-8)
    # Across the disc of the two nearest points the slope jumps: -b sqrt(1 - rho² / (a² - b²)) is
    # deepest.
    for rho in (1e4, 4e4):
        deepest = -b * np.sqrt(1.0 - rho**2 / (a**2 - b**2))
        assert grazing_height_m([rho, 0, 9e6], [rho, 0, -8e6]) == pytest.approx(
            deepest, rel=0.0, abs=1e-8
        )
    assert grazing_height_m([9e6, 1.0, 0], [9e6, -1.0, 0]) == pytest.approx(
        9e6 - a, rel=0.0, abs=1e-8
    )


def test_least_height_counts_the_ends():
    ground = geodetic_to_ecef(0.6, 0.2, 100.0)
    above = geodetic_to_ecef(0.6, 0.2, 3e7)
    assert grazing_height_m(ground, above) == pytest.approx(100.0, abs=1e-7)
    assert grazing_height_m(ground, ground) == pytest.approx(100.0, abs=1e-8)


@pytest.mark.parametrize("margin_m", [-1e4, 0.0, 1e4, 1e5])
def test_occlusion_is_a_least_height_below_the_margin(margin_m):
    rng = np.random.default_rng(2)
    target = rng.normal(size=(20000, 3))
    target *= (6.38e6 + rng.uniform(0.0, 1e6, (20000, 1))) / np.linalg.norm(
        target, axis=1, keepdims=True
    )
    occluded = is_occluded(SLOT, target, margin_m)
    least = grazing_height_m(SLOT, target)
    ends = np.minimum(ecef_to_geodetic(target).height_m, ecef_to_geodetic(SLOT).height_m)
    assert np.array_equal(occluded, (least < margin_m) & (least < ends - 1e-7))
    assert 0.3 < np.mean(occluded) < 0.7


def test_ends_do_not_hide_themselves():
    for height in (-400.0, -1e-9, 0.0, 5e3):
        ground = geodetic_to_ecef([0.1, 0.1], [0.0, 1.3], height)
        assert not np.any(is_occluded(SLOT, ground, 1e4))
    assert is_occluded(SLOT, geodetic_to_ecef(0.1, np.pi, 0.0))


def test_the_limb_by_its_grazing_height():
    """A target beyond the limb, on the line that passes the equator at a chosen height."""
    for height in (1.0, 1e3, 5e4):
        sine = (EARTH_EQUATORIAL_RADIUS_M + height) / GEOSTATIONARY_RADIUS_M
        beyond = SLOT + 6e7 * np.array([-np.sqrt(1.0 - sine**2), sine, 0.0])
        assert grazing_height_m(SLOT, beyond) == pytest.approx(height, rel=0.0, abs=1e-7)
        assert is_occluded(SLOT, beyond, height + 1e-6)
        assert not is_occluded(SLOT, beyond, height - 1e-6)


def test_a_miss_is_nan_and_so_is_what_has_no_ray():
    nowhere = [
        intersection_with_ellipsoid(SLOT, [0.0, 1.0, 0.0]),
        intersection_with_ellipsoid(SLOT, SLOT),
        intersection_with_ellipsoid(SLOT, [0.0, 0.0, 0.0]),
        intersection_with_ellipsoid(SLOT, -SLOT, -7e6),
    ]
    assert np.all(np.isnan(nowhere))
    assert intersection_with_ellipsoid(SLOT, -SLOT) == pytest.approx(
        [EARTH_EQUATORIAL_RADIUS_M, 0.0, 0.0], rel=1e-15
    )
    assert intersection_with_ellipsoid([0.0, 0.0, 0.0], [0.0, 0.0, -3.0])[2] == pytest.approx(
        -EARTH_POLAR_RADIUS_M
    )


def test_the_longer_ellipsoid_is_30_cm_off_constant_height():
    directions = np.random.default_rng(3).normal(size=(2000, 3))
    heights = ecef_to_geodetic(
        intersection_with_ellipsoid(5e7 * directions, -directions, 1e5)
    ).height_m
    assert np.max(np.abs(heights - 1e5)) < 0.3


def test_the_shadow_has_an_umbra_a_penumbra_and_an_end():
    behind = np.array([-1.0, 0.0, 0.0])
    assert sunlit_fraction(4.2e7 * behind, SUN) == 0.0
    # The umbra of the Earth is a cone of some 1.38 million km.
    assert sunlit_fraction(1.3e9 * behind, SUN) == 0.0
    assert 0.0 < sunlit_fraction(1.5e9 * behind, SUN) < 0.2
    across = np.stack([np.full(2001, -4.2e7), np.linspace(0.0, 7e6, 2001), np.zeros(2001)], axis=1)
    shares = sunlit_fraction(across, SUN)
    assert np.all(np.diff(shares) >= 0.0)
    assert (shares[0], shares[-1]) == (0.0, 1.0)
    # Umbra and penumbra end where lines from edge to edge of Sun and Earth pass: similar triangles.
    dark = across[np.sum(shares == 0.0), 1]
    light = across[np.sum(shares < 1.0), 1]
    assert dark == pytest.approx(
        EARTH_EQUATORIAL_RADIUS_M - 4.2e7 * (6.957e8 - 6378137.0) / 1.496e11, abs=5e3
    )
    assert light == pytest.approx(
        EARTH_EQUATORIAL_RADIUS_M + 4.2e7 * (6.957e8 + 6378137.0) / 1.496e11, abs=5e3
    )


def test_the_share_of_the_disc_against_counting_rays():
    """Rays to a grid over the Sun's disc, each asked whether it meets the ellipsoid."""
    grid = (np.arange(60) + 0.5) / 30.0 - 1.0
    u, v = np.meshgrid(grid, grid)
    disc = np.stack([0.0 * u, u, v], axis=-1)[u * u + v * v < 1.0] * 6.957e8 + SUN
    for x, r in ((-7e6, 6.35e6), (-4.2e7, 6.2e6), (-4.2e7, 6.3e6), (-2e7, 6.36e6), (-7e6, 6.40e6)):
        for angle in (0.0, 0.7, np.pi / 2):
            point = np.array([x, r * np.cos(angle), r * np.sin(angle)])
            counted = np.mean(np.isnan(intersection_with_ellipsoid(point, disc - point)[:, 0]))
            assert sunlit_fraction(point, SUN) == pytest.approx(counted, abs=0.012)


def test_day_and_night_on_the_ground():
    """The upper edge of the Sun is on the horizon when its centre is a solar radius below it."""
    longitude = np.radians(np.linspace(0.0, 180.0, 3601))
    ground = geodetic_to_ecef(0.4, longitude, -50.0)
    elevation = elevation_rad(ground, SUN)
    edge = np.arcsin(6.957e8 / 1.496e11)
    clear = np.abs(np.abs(elevation) - edge) > 2e-5
    assert np.array_equal(is_sunlit(ground, SUN)[clear], (elevation > -edge)[clear])
    assert np.array_equal((sunlit_fraction(ground, SUN) == 1.0)[clear], (elevation >= edge)[clear])
    assert np.isnan(sunlit_fraction([0.0, 0.0, 0.0], SUN))
    assert not is_sunlit([0.0, 0.0, 0.0], SUN)
