"""Geometry against 40-digit arithmetic (mpmath): every bound that a docstring states, at every
distance it names.
"""

import mpmath as mp
import numpy as np
import pytest

from opir_core.constants import EARTH_EQUATORIAL_RADIUS_M, EARTH_FLATTENING, EARTH_POLAR_RADIUS_M
from opir_core.geometry import (
    azimuth_elevation_range,
    ecef_to_geodetic,
    geodetic_to_ecef,
    intersection_with_ellipsoid,
    nadir_angle_rad,
)

A = mp.mpf(EARTH_EQUATORIAL_RADIUS_M)
F = mp.mpf(EARTH_FLATTENING)
B = A * (1 - F)
E2 = F * (2 - F)
CUSP_M = float(A * E2)
LUNAR_DISTANCE_M = 3.844e8


@pytest.fixture(autouse=True)
def forty_digits():
    with mp.workdps(40):
        yield


def directions(count, seed):
    vectors = np.random.default_rng(seed).normal(size=(count, 3))
    return vectors / np.sqrt(np.sum(vectors**2, axis=1, keepdims=True))


def exact_ecef(latitude, longitude, height):
    latitude = mp.mpf(latitude)
    longitude = mp.mpf(longitude)
    height = mp.mpf(height)
    normal = A / mp.sqrt(1 - E2 * mp.sin(latitude) ** 2)
    rho = (normal + height) * mp.cos(latitude)
    return (
        rho * mp.cos(longitude),
        rho * mp.sin(longitude),
        (normal * (1 - E2) + height) * mp.sin(latitude),
    )


def misplacement_m(positions):
    """The distance between positions and where their latitude, longitude and height, taken exactly,
    are.
    """
    result = np.transpose([np.ravel(column) for column in ecef_to_geodetic(positions)])
    worst = mp.mpf(0)
    for position, geodetic in zip(np.reshape(positions, (-1, 3)), result, strict=True):
        named = exact_ecef(*geodetic)
        worst = max(worst, sum((mp.mpf(p) - n) ** 2 for p, n in zip(position, named, strict=True)))
    return float(mp.sqrt(worst))


@pytest.mark.slow
@pytest.mark.parametrize(
    "radius_m", [10.0**power for power in range(-9, 7)] + [1.27e6, 1.28e6, 6.3e6, 6.4e6, 9.9e6]
)
def test_position_is_named_within_3_nm_below_10_000_km(radius_m):
    assert misplacement_m(directions(150, 1) * radius_m) <= 3e-9


def test_position_is_named_within_15_nm_at_geostationary_distance():
    assert misplacement_m(directions(4000, 2) * 4.2164e7) <= 1.5e-8


@pytest.mark.slow
@pytest.mark.parametrize("seed", range(3))
def test_position_is_named_within_120_nm_at_the_moon(seed):
    assert misplacement_m(directions(4000, seed) * LUNAR_DISTANCE_M) <= 1.2e-7


@pytest.mark.parametrize("away_m", [0.0] + [10.0**power for power in range(-12, 5)])
def test_position_is_named_within_3_nm_about_the_cusp_of_the_evolute(away_m):
    rng = np.random.default_rng(3)
    longitude = rng.uniform(-np.pi, np.pi, 60)
    (out, up) = away_m * rng.normal(size=(2, 60))
    rho = CUSP_M + out
    assert (
        misplacement_m(np.stack([rho * np.cos(longitude), rho * np.sin(longitude), up], axis=1))
        <= 3e-9
    )


@pytest.mark.parametrize("height_m", [-0.0, 0.0, 5e-324, 1e-300, -1e-300, 1e-12, -1e-12, 1e-3])
def test_position_is_named_within_3_nm_on_and_beside_the_equatorial_disc(height_m):
    rho = np.concatenate(
        [np.linspace(0.0, 1.1 * CUSP_M, 60), CUSP_M + np.linspace(-1e-9, 1e-9, 21)]
    )
    assert misplacement_m(np.stack([rho, 0.0 * rho, 0.0 * rho + height_m], axis=1)) <= 3e-9


@pytest.mark.parametrize("aside_m", [0.0, 5e-324, 1e-160, 1e-9, 1e-3])
def test_position_is_named_on_and_beside_the_axis(aside_m):
    z = np.concatenate([np.linspace(-1e7, 1e7, 101), [B, -B, np.nextafter(float(B), 0.0)]]).astype(
        float
    )
    assert misplacement_m(np.stack([0.0 * z + aside_m, 0.0 * z - aside_m, z], axis=1)) <= 3e-9


def exact_latitude(rho, z, guess):
    def miss(t):
        return z - mp.tan(t) * (rho - E2 * A * mp.cos(t) / mp.sqrt(1 - E2 * mp.sin(t) ** 2))

    return mp.findroot(miss, guess)


@pytest.mark.slow
def test_latitude_and_height_are_good_to_one_unit_in_the_last_place_off_the_centre():
    for radius in (3e6, 6.4e6, 4.2e7, LUNAR_DISTANCE_M):
        for position in directions(150, 4) * radius:
            latitude, _, height = map(float, ecef_to_geodetic(position))
            rho = mp.hypot(*map(mp.mpf, position[:2]))
            z = mp.mpf(position[2])
            exact = exact_latitude(rho, z, latitude)
            normal = A / mp.sqrt(1 - E2 * mp.sin(exact) ** 2)
            exact_height = rho * mp.cos(exact) + z * mp.sin(exact) - A * A / normal
            assert abs(height - exact_height) <= 0.55 * np.spacing(abs(height)) + 3e-9
            assert abs(latitude - exact) <= np.spacing(abs(latitude)) + 3e-9 / radius * (
                radius < 1e7
            )


@pytest.mark.slow
def test_inside_the_earth_the_height_is_the_distance_to_the_nearest_point():
    """Against a dense walk round the whole meridian ellipse, all four quadrants of it."""
    t = np.linspace(-np.pi, np.pi, 20001)
    edge_rho = EARTH_EQUATORIAL_RADIUS_M * np.cos(t)
    edge_z = EARTH_POLAR_RADIUS_M * np.sin(t)
    for radius in (1.0, 1e3, 2e4, 4e4, 5e4, 1e6, 5e6):
        for x, y, z in directions(40, 5) * radius:
            walked = np.min(np.hypot(np.hypot(x, y) - edge_rho, z - edge_z))
            assert ecef_to_geodetic([x, y, z]).height_m == pytest.approx(-walked, rel=0.0, abs=1.0)


def test_geodetic_to_ecef_is_exact_to_rounding():
    rng = np.random.default_rng(6)
    for height, bound in ((-6e6, 2e-9), (0.0, 3e-9), (1e5, 3e-9), (3.6e7, 2e-8), (3.8e8, 2e-7)):
        for latitude, longitude in zip(
            np.arcsin(rng.uniform(-1, 1, 100)), rng.uniform(-np.pi, np.pi, 100), strict=True
        ):
            result = geodetic_to_ecef(latitude, longitude, height)
            exact = exact_ecef(latitude, longitude, height)
            assert mp.norm([mp.mpf(f) - e for f, e in zip(result, exact, strict=True)]) <= bound


def first_point(origin, ray, height=0.0):
    """The first point of a ray on the ellipsoid, and the cosine to the outward normal there; None
    on a miss.
    """
    axes = [A + height, A + height, B + height]
    o, d = [[mp.mpf(v) / s for v, s in zip(vector, axes, strict=True)] for vector in (origin, ray)]
    dd = mp.fdot(d, d)
    od = mp.fdot(o, d)
    oo = mp.fdot(o, o) - 1
    if od * od < dd * oo:
        return None
    root = mp.sqrt(od * od - dd * oo)
    steps = [step for step in ((-od - root) / dd, (-od + root) / dd) if step >= 0]
    if not steps:
        return None
    point = [mp.mpf(v) + steps[0] * mp.mpf(w) for v, w in zip(origin, ray, strict=True)]
    normal = [p / s**2 for p, s in zip(point, axes, strict=True)]
    return point, abs(mp.fdot(normal, map(mp.mpf, ray))) / mp.norm(normal) / mp.norm(
        list(map(mp.mpf, ray))
    )


@pytest.mark.slow
@pytest.mark.parametrize(
    ("radius_m", "rounding_m"), [(6.4e6, 3e-9), (7e6, 3e-9), (2.66e7, 2e-8), (4.2164e7, 2.5e-8)]
)
@pytest.mark.parametrize("share_of_limb", [0.0, 0.5, 0.9, 0.999, 0.999999, 1.0, 1.001])
@pytest.mark.parametrize("height_m", [0.0, 1e5])
def test_intersection_is_exact_to_rounding_over_the_sine_of_grazing(
    radius_m, rounding_m, share_of_limb, height_m
):
    up = directions(60, 7)
    across = np.cross(up, directions(60, 8))
    across /= np.linalg.norm(across, axis=1, keepdims=True)
    radius_m = radius_m + height_m
    sine = share_of_limb * (6356752.0 + height_m) / radius_m
    rays = across * sine - up * np.sqrt(1.0 - sine * sine)
    for origin, ray, result in zip(
        up * radius_m, rays, intersection_with_ellipsoid(up * radius_m, rays, height_m), strict=True
    ):
        exact = first_point(origin, ray, height_m)
        assert (exact is None) == bool(np.isnan(result[0]))
        if exact is not None:
            point, sine_at_ground = exact
            assert (
                mp.norm([mp.mpf(f) - p for f, p in zip(result, point, strict=True)])
                <= rounding_m / sine_at_ground
            )


def test_intersection_from_inside_is_where_the_ray_leaves():
    origins = directions(100, 9) * 6e6
    rays = directions(100, 10)
    for origin, ray, result in zip(
        origins, rays, intersection_with_ellipsoid(origins, rays), strict=True
    ):
        point, _ = first_point(origin, ray)
        assert mp.norm([mp.mpf(f) - p for f, p in zip(result, point, strict=True)]) <= 1e-8


@pytest.mark.parametrize("angle", [1e-15, 1e-9, 1e-3, 1.0, 3.0, np.pi - 1e-9, np.pi - 1e-15])
def test_nadir_angle_is_exact_near_nothing_and_near_a_half_turn(angle):
    for up, direction in zip(directions(50, 11), directions(50, 12), strict=True):
        across = np.cross(up, direction) / np.linalg.norm(np.cross(up, direction))
        sensor = up * 4.2164e7
        target = sensor + 3.6e7 * (across * np.sin(angle) - up * np.cos(angle))
        s = list(map(mp.mpf, sensor))
        t = list(map(mp.mpf, target))
        d = [b - a for a, b in zip(s, t, strict=True)]
        cross = [s[1] * d[2] - s[2] * d[1], s[2] * d[0] - s[0] * d[2], s[0] * d[1] - s[1] * d[0]]
        assert (
            abs(nadir_angle_rad(sensor, target) - mp.atan2(mp.norm(cross), -mp.fdot(s, d))) <= 1e-15
        )


def test_azimuth_elevation_and_range_are_exact_to_rounding():
    for o, t in zip(directions(200, 13) * 7.2e6, directions(200, 14) * 6.5e6, strict=True):
        azimuth, elevation, distance = azimuth_elevation_range(o, t)
        latitude, longitude, _ = map(mp.mpf, ecef_to_geodetic(o))
        d = [mp.mpf(b) - mp.mpf(a) for a, b in zip(o, t, strict=True)]
        outward = mp.cos(longitude) * d[0] + mp.sin(longitude) * d[1]
        east = mp.cos(longitude) * d[1] - mp.sin(longitude) * d[0]
        north = mp.cos(latitude) * d[2] - mp.sin(latitude) * outward
        up = mp.sin(latitude) * d[2] + mp.cos(latitude) * outward
        level = mp.hypot(east, north)
        assert abs(elevation - mp.atan2(up, level)) <= 2e-15
        assert (
            abs((azimuth - mp.atan2(east, north) + mp.pi) % (2 * mp.pi) - mp.pi) * level / distance
            <= 2e-15
        )
        assert abs(distance / mp.norm(d) - 1) <= 4e-16
