"""Where two-body arcs come down: on the surface, not before, once, and nowhere when they do not."""

import numpy as np
import pytest
from lone_rows import assert_rows_independent

from opir_core.constants import EARTH_EQUATORIAL_RADIUS_M, EARTH_MU_M3_S2, EARTH_POLAR_RADIUS_M
from opir_core.flight import kepler_impact, propagate_kepler
from opir_core.geometry import ecef_to_geodetic, geodetic_to_ecef

pytestmark = pytest.mark.filterwarnings("error")


def unit_vectors(rng, count):
    up, along = rng.normal(size=(2, count, 3))
    up /= np.linalg.norm(up, axis=1)[:, None]
    along = np.cross(up, along)
    return up, along / np.linalg.norm(along, axis=1)[:, None]


def arcs(rng, radius, speed, elevation):
    """Return states of these radii, speeds and flight-path angles, in every direction."""
    up, along = unit_vectors(rng, radius.size)
    direction = np.sin(elevation)[:, None] * up + np.cos(elevation)[:, None] * along
    return radius[:, None] * up, speed[:, None] * direction


def conics(rng, e, q, nu):
    """Return states on conics of these eccentricities, pericentre distances and true anomalies."""
    pericentre, along = unit_vectors(rng, e.size)
    p = q * (1.0 + e)
    r = p / (1.0 + e * np.cos(nu))
    scale = np.sqrt(EARTH_MU_M3_S2 / p)
    position = r[:, None] * (np.cos(nu)[:, None] * pericentre + np.sin(nu)[:, None] * along)
    return position, scale[:, None] * (
        -np.sin(nu)[:, None] * pericentre + (e + np.cos(nu))[:, None] * along
    )


def launches(count=3000, seed=5):
    rng = np.random.default_rng(seed)
    radius = 6378e3 + rng.uniform(50e3, 300e3, count)
    return arcs(
        rng, radius, rng.uniform(100.0, 7.4e3, count), np.radians(rng.uniform(2.0, 90.0, count))
    )


def general(rng, count):
    return arcs(
        rng,
        rng.uniform(5e6, 9e6, count),
        rng.uniform(0.0, 11.5e3, count),
        rng.uniform(-1.57, 1.57, count),
    )


def nearly_circular(rng, count):
    radius = rng.uniform(6.35e6, 6.385e6, count)
    speed = np.sqrt(EARTH_MU_M3_S2 / radius) * (1.0 + 1e-3 * rng.normal(size=count))
    return arcs(rng, radius, speed, 2e-3 * rng.normal(size=count))


def grazing_ellipses(rng, count):
    q = 6367e3 + rng.uniform(-15e3, 15e3, count)
    return conics(rng, rng.uniform(0.01, 0.95, count), q, rng.uniform(-3.0, 3.0, count))


def grazing_hyperbolas(rng, count):
    e = rng.uniform(1.001, 3.0, count)
    q = 6367e3 + rng.uniform(-15e3, 15e3, count)
    return conics(rng, e, q, -np.arccos(-1.0 / e) * rng.uniform(0.1, 0.95, count))


def from_the_surface(rng, count):
    direction, _ = unit_vectors(rng, count)
    position = geodetic_to_ecef(
        np.arcsin(direction[:, 2]), np.arctan2(direction[:, 1], direction[:, 0]), 0.0
    )
    _, velocity = arcs(rng, np.ones(count), 10.0 ** rng.uniform(-1.0, 4.0, count), np.zeros(count))
    up = position / np.linalg.norm(position, axis=1)[:, None]
    climb = rng.uniform(-1.0, 1.0, count) * np.linalg.norm(velocity, axis=1)
    return position, velocity + climb[:, None] * up


def first_descent(position, velocity, height, longest_s, samples=4001):
    """Return the sampled interval of the first descent through the height: nan where there is
    none.
    """
    times = np.linspace(0.0, longest_s, samples)
    above = ecef_to_geodetic(propagate_kepler(position, velocity, times)[0]).height_m - height
    outside = above > 0.0
    outside[0] = above[0] > 1e-6
    if abs(above[0]) <= 1e-6 and not outside[1]:
        return 0.0, 0.0
    falls = np.flatnonzero(outside[:-1] & ~outside[1:])
    return (times[falls[0]], times[falls[0] + 1]) if falls.size else (np.nan, np.nan)


def have_come_down(position, velocity, height):
    """Return which starts are below the height and descend, by their heights a hundredth of a
    second later.
    """
    start, end = (ecef_to_geodetic(position + s * velocity).height_m for s in (0.0, 1e-2))
    return (start < height - 1e-6) & (end < start)


def longest_flight(position, velocity):
    """Return a period, or for open arcs some hours."""
    alpha = 2.0 / np.linalg.norm(position, axis=1) - np.sum(velocity**2, axis=1) / EARTH_MU_M3_S2
    return np.where(
        alpha > 0.0, 2.0 * np.pi / np.sqrt(EARTH_MU_M3_S2 * np.abs(alpha) ** 3), 40_000.0
    )


def assert_on_arc_and_surface(position, velocity, height, duration, point):
    hit = np.isfinite(duration)
    assert hit.any()
    state = position[hit], velocity[hit]
    end, speed = propagate_kepler(*state, duration[hit])
    later, _ = propagate_kepler(*state, duration[hit] * (1.0 + 4e-16))
    rounding = np.linalg.norm(later - end, axis=1)
    assert np.all(np.linalg.norm(end - point[hit], axis=1) <= 1e-7 + 100.0 * rounding)
    heights = ecef_to_geodetic(point[hit]).height_m
    assert np.max(np.abs(heights - np.broadcast_to(height, hit.shape)[hit])) <= 2e-7
    sizes = np.linalg.norm(speed, axis=1) * np.linalg.norm(end, axis=1)
    assert np.all(np.sum(speed * end, axis=1) < 0.05 * sizes)


@pytest.mark.parametrize("height", [0.0, 100e3, -50e3])
def test_launches_come_down_on_the_surface(height):
    position, velocity = launches()
    duration, point = kepler_impact(position, velocity, height)
    rises = np.ones(duration.shape, bool) if height < 50e3 else np.isfinite(duration)
    assert np.isfinite(duration[rises]).all()
    assert_on_arc_and_surface(position, velocity, height, duration, point)


@pytest.mark.slow
@pytest.mark.parametrize("height", [0.0, 120e3])
@pytest.mark.parametrize(
    "family",
    [general, nearly_circular, grazing_ellipses, grazing_hyperbolas, from_the_surface],
    ids=lambda f: f.__name__,
)
def test_it_is_the_first_descent(family, height):
    position, velocity = family(np.random.default_rng(11), 60)
    if height:
        position = position * (1.0 + height / 6378e3)
        velocity = velocity / np.sqrt(1.0 + height / 6378e3)
    duration, point = kepler_impact(position, velocity, height)
    down = have_come_down(position, velocity, height)
    assert np.all(duration[down] == 0.0)
    np.testing.assert_allclose(point[down], position[down], atol=2e-9)
    flights = [column[~down] for column in (position, velocity, duration, point)]
    assert_on_arc_and_surface(*flights[:2], height, *flights[2:])
    for row in zip(*flights[:3], strict=True):
        assert_no_descent_before(*row, height, is_short=family is from_the_surface)


def assert_no_descent_before(position, velocity, duration, height, *, is_short):
    """An impact is in the first sampled interval of descent, or in one that sampling misses."""
    longest = np.fmax(longest_flight(position[None], velocity[None])[0], duration * 1.2)
    if is_short and np.isfinite(duration):
        longest = min(longest, 2.0 * duration + 1.0)
    start, end = first_descent(position, velocity, height, longest)
    if np.isnan(start):
        assert np.isnan(duration) or duration <= longest
        return
    assert duration <= end + 1e-3
    if duration < start - 1e-3:
        times = duration + np.linspace(0.0, longest / 4000.0, 200)
        inside, _ = propagate_kepler(position, velocity, times)
        assert np.min(ecef_to_geodetic(inside).height_m - height) <= 2e-7


@pytest.mark.parametrize(
    ("latitude", "radius"),
    [(0.0, EARTH_EQUATORIAL_RADIUS_M), (np.pi / 2.0, EARTH_POLAR_RADIUS_M)],
)
def test_straight_up_and_down(latitude, radius):
    start = geodetic_to_ecef(latitude, 0.3, 0.0)
    up = start / np.linalg.norm(start)
    duration, point = kepler_impact(start, 3000.0 * up)
    assert duration > 600.0
    np.testing.assert_allclose(point, start, atol=1e-7)
    duration, point = kepler_impact(2.0 * start, 0.0 * up)
    np.testing.assert_allclose(np.linalg.norm(point), radius, atol=1e-7)
    end, _ = propagate_kepler(2.0 * start, 0.0 * up, duration)
    np.testing.assert_allclose(end, point, atol=1e-7)


def test_a_start_on_the_surface():
    start = geodetic_to_ecef(0.6, 1.0, 0.0)
    up = start / np.linalg.norm(start)
    north = np.cross(start, np.cross([0.0, 0.0, 1.0], start))
    north /= np.linalg.norm(north)
    rising, _ = kepler_impact(start, 1000.0 * up + 500.0 * north)
    assert 200.0 < rising < 230.0
    falling, point = kepler_impact(start, -1000.0 * up + 500.0 * north)
    assert falling == 0.0
    np.testing.assert_allclose(point, start, atol=2e-9)
    end = propagate_kepler(start, 1000.0 * up + 500.0 * north, rising)
    assert kepler_impact(*end)[0] == 0.0


@pytest.mark.parametrize("depth_m", [1e-5, 1.0, 50.0, 5e3, 60e3])
def test_a_start_below_that_descends_has_come_down(depth_m):
    for latitude in (0.0, 0.6, np.pi / 2.0):
        start, higher = (
            geodetic_to_ecef(latitude, 1.0, height) for height in (-depth_m, 1.0 - depth_m)
        )
        up = higher - start
        east = np.array([-np.sin(1.0), np.cos(1.0), 0.0])
        duration, point = kepler_impact(start, 2000.0 * east - 300.0 * up)
        assert duration == 0.0
        np.testing.assert_allclose(point, start, atol=2e-9)


def test_a_launch_from_below_the_ellipsoid_comes_down_on_it():
    """Straight up at the equator: the time to fall from the top is that of a radial ellipse, in
    closed form.
    """
    start = EARTH_EQUATORIAL_RADIUS_M - 400.0
    speed = 1500.0
    duration, _ = kepler_impact([start, 0.0, 0.0], [speed, 0.0, 0.0])
    a = 1.0 / (2.0 / start - speed**2 / EARTH_MU_M3_S2)

    def since_top(radius):
        share = radius / (2.0 * a)
        return np.sqrt((2.0 * a) ** 3 / (2.0 * EARTH_MU_M3_S2)) * (
            np.arccos(np.sqrt(share)) + np.sqrt(share * (1.0 - share))
        )

    assert duration == pytest.approx(
        since_top(start) + since_top(EARTH_EQUATORIAL_RADIUS_M), rel=1e-9
    )


def test_a_start_below_has_to_rise_first():
    start = np.array([6300e3, 0.0, 0.0])
    up = np.array([1.0, 0.0, 0.0])
    duration, point = kepler_impact(start, 3000.0 * up)
    way, _ = propagate_kepler(start, 3000.0 * up, np.linspace(0.0, duration, 1000))
    assert ecef_to_geodetic(way).height_m.max() > 300e3
    np.testing.assert_allclose(np.linalg.norm(point), EARTH_EQUATORIAL_RADIUS_M, atol=1e-7)
    assert np.isnan(kepler_impact(start, 100.0 * up)[0])


@pytest.mark.parametrize("depth_m", [1e3, 1.0, 1e-3, 1e-5, -1e-5, -1e-3, -1.0, -1e3])
@pytest.mark.parametrize("e", [0.02, 0.7, 1.0, 2.5])
def test_only_a_pericentre_below_the_surface_is_an_impact(e, depth_m):
    q = EARTH_EQUATORIAL_RADIUS_M - depth_m
    speed = np.sqrt(EARTH_MU_M3_S2 * (1.0 + e) / q)
    start = propagate_kepler([q, 0.0, 0.0], [0.0, speed, 0.0], -1500.0)
    duration, point = kepler_impact(*start)
    assert np.isfinite(duration) == (depth_m > 0.0)
    if depth_m > 0.0:
        assert duration < 1500.0
        assert abs(ecef_to_geodetic(point).height_m) <= 2e-7


@pytest.mark.parametrize(
    ("position", "velocity", "height"),
    [
        ([7e6, 0, 0], [0, 7546.0, 0], 0.0),
        ([7e6, 0, 0], [0, 12e3, 0], 0.0),
        ([7e6, 0, 0], [12e3, 0, 0], 0.0),
        ([7e6, 0, 0], [0, 7000.0, np.nan], 0.0),
        ([0, 0, 0], [0, 7000.0, 0], 0.0),
        ([7e6, 0, 0], [0, 1.0, 0], np.inf),
        ([7e6, 0, 0], [0, 1.0, 0], -6.1e6),
        ([7e6, 0, 0], [0, 1.0, 0], 800e3),
    ],
)
def test_no_impact_is_nan(position, velocity, height):
    duration, point = kepler_impact(position, velocity, height)
    assert np.isnan([duration, *point]).all()


def test_an_element_has_the_same_bits_in_any_company():
    rng = np.random.default_rng(8)
    families = (general, nearly_circular, grazing_ellipses, from_the_surface)
    states = (np.concatenate(x) for x in zip(*(f(rng, 50) for f in families), strict=True))
    assert_rows_independent(
        kepler_impact, *states, rows=(slice(0, 1), slice(7, 90), slice(120, 200))
    )


def test_turning_the_scene_about_the_axis_turns_the_impact():
    position, velocity = launches(500)
    cosine = np.cos(1.1)
    sine = np.sin(1.1)
    turn = np.array([[cosine, -sine, 0.0], [sine, cosine, 0.0], [0.0, 0.0, 1.0]])
    duration, point = kepler_impact(position, velocity)
    turned, turned_point = kepler_impact(position @ turn.T, velocity @ turn.T)
    np.testing.assert_allclose(turned, duration, rtol=1e-11)
    np.testing.assert_allclose(turned_point, point @ turn.T, atol=1e-5)


def test_shapes():
    duration, point = kepler_impact(
        np.tile([7e6, 0.0, 0.0], (4, 1, 1)), [0.0, 1e3, 0.0], [0.0, 10e3]
    )
    assert duration.shape == (4, 2)
    assert point.shape == (4, 2, 3)


@pytest.mark.parametrize("eccentricity", [0.0, 1e-12, 1e-9, 1e-8, 1e-7])
@pytest.mark.parametrize("height", [-400.0, 0.0, 1e7, 1e8])
def test_circular_orbits_that_dip_below_the_surface_come_down(eccentricity, height):
    rng = np.random.default_rng(17)
    radius = 0.5 * (EARTH_EQUATORIAL_RADIUS_M + EARTH_POLAR_RADIUS_M) + height
    angle = np.linspace(0.05, 6.2, 40)
    node = np.array([[1.0, 0.0, 0.0]])
    across = np.array([[0.0, 0.2, 1.0]]) / np.sqrt(1.04)
    out = np.cos(angle)[:, None] * node + np.sin(angle)[:, None] * across
    along = np.cos(angle)[:, None] * across - np.sin(angle)[:, None] * node
    speed = np.sqrt(EARTH_MU_M3_S2 / radius) * (1.0 + eccentricity * rng.normal(size=40))
    position = radius * out
    velocity = speed[:, None] * along
    duration, point = kepler_impact(position, velocity, height)
    assert np.isfinite(duration).all()
    has_fallen = duration > 0.0  # the others start below the surface, and descend
    assert has_fallen.sum() >= 20
    assert np.max(np.abs(ecef_to_geodetic(point[has_fallen]).height_m - height)) < 2e-6
