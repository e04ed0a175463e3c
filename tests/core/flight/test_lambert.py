"""Lambert's problem: the velocities found carry one end to the other, every way, or there are
none.
"""

import numpy as np
import pytest

from opir_core.constants import EARTH_MU_M3_S2
from opir_core.flight.kepler import propagate_kepler
from opir_core.flight.lambert_solver import lambert

pytestmark = pytest.mark.filterwarnings("error")


def ends(count=2000, seed=2, separation=None):
    """Return two points within a few Earth radii, at a given angle (rad) or any, and a time of a
    minute to an hour.
    """
    rng = np.random.default_rng(seed)
    first, second = rng.normal(size=(2, count, 3))
    first /= np.linalg.norm(first, axis=1)[:, None]
    second = np.cross(first, second)
    second /= np.linalg.norm(second, axis=1)[:, None]
    angle = np.full(count, separation) if separation is not None else rng.uniform(0.01, 3.1, count)
    second = np.cos(angle)[:, None] * first + np.sin(angle)[:, None] * second
    r1, r2 = rng.uniform(6.4e6, 2e7, (2, count))
    return r1[:, None] * first, r2[:, None] * second, 10.0 ** rng.uniform(1.8, 3.6, count)


def rounding_of_arrival(first, v1, duration, there):
    """Return how far one part in 1e-15 of the speed, in any direction, moves the end."""
    speed = np.linalg.norm(v1, axis=1)[:, None]
    nudged = (propagate_kepler(first, v1 + 1e-15 * speed * axis, duration)[0] for axis in np.eye(3))
    return sum(np.linalg.norm(end - there, axis=1) for end in nudged)


def turning(position, velocity):
    return np.cross(position, velocity)


@pytest.mark.parametrize("way", ["short", "long", "prograde", "retrograde"])
def test_the_arc_arrives(way):
    first, second, duration = ends()
    v1, v2 = lambert(first, second, duration, way=way)
    assert np.isfinite(v1).all()
    there, arriving = propagate_kepler(first, v1, duration)
    bar = 1e-6 + 100.0 * rounding_of_arrival(first, v1, duration, there)
    assert np.all(np.linalg.norm(there - second, axis=1) <= bar)
    speed = np.linalg.norm(v2, axis=1)
    slow = speed < 3e4
    assert np.all(np.linalg.norm(arriving - v2, axis=1)[slow] <= 1e-8)


def test_the_ways_go_the_ways_they_say():
    first, second, duration = ends()
    across = np.cross(first, second)
    assert np.all(
        np.sum(turning(first, lambert(first, second, duration, way="short")[0]) * across, axis=1)
        > 0.0
    )
    assert np.all(
        np.sum(turning(first, lambert(first, second, duration, way="long")[0]) * across, axis=1)
        < 0.0
    )
    assert np.all(turning(first, lambert(first, second, duration, way="prograde")[0])[:, 2] > 0.0)
    assert np.all(turning(first, lambert(first, second, duration, way="retrograde")[0])[:, 2] < 0.0)


@pytest.mark.parametrize("separation", [1e-9, 1e-6, 1e-3, np.pi - 1e-3, np.pi - 1e-6])
def test_points_nearly_in_line(separation):
    first, second, duration = ends(300, separation=separation)
    v1, _ = lambert(first, second, duration)
    there, _ = propagate_kepler(first, v1, duration)
    assert np.max(np.linalg.norm(there - second, axis=1)) <= 1e-5


@pytest.mark.parametrize("hop_m", [1e-3, 1.0, 1e3])
def test_short_hops(hop_m):
    """A target next to the launcher, in any time: down to a millimetre in 100 s."""
    first = np.array([3e6, -4e6, 4e6])
    second = first + hop_m * np.array([0.6, 0.0, -0.8])
    duration = np.array([1.0, 10.0, 100.0, 1000.0])
    v1, _ = lambert(first, second, duration)
    there, _ = propagate_kepler(first, v1, duration)
    assert np.max(np.linalg.norm(there - second, axis=1)) <= 1e-8


def test_points_on_one_ray_are_joined_by_a_straight_line():
    ray = np.array([1.0, 2.0, 2.0]) / 3.0
    for r1, r2, duration in (
        (7e6, 8e6, 600.0),
        (8e6, 7e6, 100.0),
        (7e6, 8e6, 5000.0),
        (7e6, 7e6, 300.0),
        (7e6, 7e6, 9e4),
    ):
        v1, v2 = lambert(r1 * ray, r2 * ray, duration)
        assert np.linalg.norm(np.cross(v1, ray)) <= 1e-9 * np.linalg.norm(v1)
        there, arriving = propagate_kepler(r1 * ray, v1, duration)
        # The last of them is up for a day: rounding its speed moves its end by this much.
        assert np.linalg.norm(there - r2 * ray) <= 1e-5
        assert np.linalg.norm(arriving - v2) <= 1e-8


def test_the_time_of_the_parabola_is_an_ordinary_time():
    """Euler's time between 90 degrees of true anomaly and its neighbours on either side."""
    q = 7e6
    first = np.array([q, 0.0, 0.0])
    second = np.array([0.0, 2.0 * q, 0.0])
    parabolic = 4.0 / 3.0 * np.sqrt(2.0 * q**3 / EARTH_MU_M3_S2)
    for factor in (1.0, 1.0 - 1e-15, 1.0 + 1e-15, 1.0 - 1e-9, 1.0 + 1e-9, 1.0 - 1e-4, 1.0 + 1e-4):
        v1, _ = lambert(first, second, factor * parabolic)
        assert np.linalg.norm(v1) == pytest.approx(
            np.sqrt(2.0 * EARTH_MU_M3_S2 / q), rel=abs(factor - 1.0) + 1e-14
        )
        assert np.linalg.norm(propagate_kepler(first, v1, factor * parabolic)[0] - second) <= 1e-7


def test_nothing_where_there_is_no_arc():
    def none(*arguments, **ways):
        return np.isnan(np.array(lambert(*arguments, **ways))).all()

    ray = np.array([7e6, 0.0, 0.0])
    assert none(ray, -ray, 600.0)
    assert none(ray, 1.5 * ray, 600.0, way="long")
    assert none(ray, ray, 600.0, way="long")
    assert none(ray, [0, 7e6, 0], 0.0)
    assert none(ray, [0, 7e6, 0], -600.0)
    assert none(ray, [0, 7e6, 0], np.nan)
    assert none(ray, [0, 7e6, 0], np.inf)
    assert none(ray, [0, 0, 0], 600.0)
    assert none(ray, [np.nan, 7e6, 0], 600.0)


def test_an_element_has_the_same_bits_in_any_company():
    first, second, duration = ends(500)
    whole = lambert(first, second, duration)
    for part in (slice(0, 1), slice(3, 4), slice(10, 333)):
        for all_, some in zip(
            whole, lambert(first[part], second[part], duration[part]), strict=True
        ):
            assert np.array_equal(all_[part], some)


def test_shapes():
    v1, v2 = lambert([7e6, 0, 0], np.tile([0.0, 8e6, 0.0], (5, 1, 1)), [1000.0, 2000.0])
    assert v1.shape == v2.shape == (5, 2, 3)


def test_wrong_arguments_are_named():
    with pytest.raises(ValueError, match="way must be one of short, long"):
        lambert([7e6, 0, 0], [0, 7e6, 0], 600.0, way="fast")
    with pytest.raises(ValueError, match="mu_m3_s2"):
        lambert([7e6, 0, 0], [0, 7e6, 0], 600.0, -1.0)


@pytest.mark.parametrize("off_rad", [1e-6, 1e-9, 1e-12, 1e-15])
@pytest.mark.parametrize("way", ["short", "long", "prograde", "retrograde"])
def test_almost_opposite_points_are_joined(off_rad, way):
    first, second, duration = ends(count=300, seed=8, separation=np.pi - off_rad)
    v1, v2 = lambert(first, second, duration, way=way)
    there, speed = propagate_kepler(first, v1, duration)
    # The plane of the arc is known as well as the points: to the rounding of both.
    miss = np.linalg.norm(there - second, axis=1)
    assert np.all(
        miss
        <= 100.0 * rounding_of_arrival(first, v1, duration, there) + 1e-14 * np.linalg.norm(second)
    )
    assert np.max(np.linalg.norm(speed - v2, axis=1) / np.linalg.norm(v2, axis=1)) < 1e-6
