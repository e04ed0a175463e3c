"""When and where the law of boosts says that a target in flight was launched, on boosts that share
no code with it.
"""

import numpy as np
import pytest
from opir_trackers.forecast.ascents import LONGEST_S, AscentRows, ascents_of
from opir_trackers.forecast.kernel_regression import hidden_moments
from opir_trackers.forecast.outcomes import Outcomes
from opir_trackers.forecast.since_launch import InFlight, _log_prior, launch_of
from opir_trackers.forecast.vehicles import vehicle_model
from opir_trackers.launch_points import AT_ONCE, EDGES_S, delays_at_once
from plain_boosts import RADIUS_M, flown

from opir_core.geometry import geodetic_to_ecef
from opir_core.scene import core_hypotheses

ASCENTS = ascents_of(Outcomes(vehicle_model(), core_hypotheses()))
SOON = delays_at_once(np.array([0.1, 0.1]), np.array([0.6, 0.7]), np.ones((1, 2), dtype=np.bool_))[
    0
]
SIGMA = np.repeat([150.0, 40.0], 3)
LATITUDE = 0.7


def in_flight(boost, since_s, seen_s=5.0, rng=None, height_m=0.0):
    """Return where a boost began, on the ellipsoid, and the target as two sensors see it after a
    time.
    """
    start, state = flown(*boost, since_s, LATITUDE)
    site = geodetic_to_ecef(LATITUDE, 0.0, height_m)
    place = site + state[:3] - start
    seen = np.concatenate([place, state[3:6]])
    if rng is not None:
        seen = seen + SIGMA * rng.standard_normal(6)
    return site, InFlight(seen, np.diag(SIGMA**2), seen_s, SOON, 0.5)


def test_launches_of_many_kinds_were_when_and_where_the_law_says():
    """Their forces, pitch-overs and headings are none of its draws; the time is unknown to a fifth
    of itself.
    """
    rng = np.random.default_rng(5)
    squared = []
    late = []
    while len(late) < 40:
        since_s = float(rng.uniform(25.0, 70.0))
        boost = (
            rng.uniform(0.0, 6.28),
            np.radians(rng.uniform(4.0, 14.0)),
            rng.uniform(14.0, 26.0),
            0.006,
        )
        site, target = in_flight(boost, since_s, rng=rng)
        if target.state[:3] @ target.state[3:] <= 0.0:
            continue
        mean, covariance = launch_of(ASCENTS, target)
        error = mean - np.append(site, since_s)
        squared.append(error @ np.linalg.solve(covariance, error) / 4.0)
        late.append(error[3] / since_s)
        assert np.linalg.norm(error[:3]) < 0.2 * np.linalg.norm(target.state[:3] - site) + 2e3
    assert np.mean(np.array(squared) < 9.49 / 4.0) >= 0.9
    assert 0.2 < np.mean(squared) < 1.5
    assert np.sqrt(np.mean(np.square(late))) < 0.25


def test_the_place_is_known_across_the_heading_better_than_along_it():
    site, target = in_flight((0.9, np.radians(9.0), 20.0, 0.006), 50.0)
    _, covariance = launch_of(ASCENTS, target)
    up = site / np.linalg.norm(site)
    level = target.state[3:] - (target.state[3:] @ up) * up
    ahead = level / np.linalg.norm(level)
    across = np.cross(up, ahead)
    along, aside = (np.sqrt(axis @ covariance[:3, :3] @ axis) for axis in (ahead, across))
    assert 300.0 < aside < 0.7 * along


@pytest.mark.parametrize("azimuth", [0.0, 2.0, 4.0])
def test_the_earth_turns_below_a_flight(azimuth):
    """A minute after the launch, 28 km away: unless the turn of the heading counts, the place is
    off by over 30 m.
    """
    site, target = in_flight((azimuth, np.radians(12.0), 22.0, 0.006), 60.0)
    mean, _ = launch_of(ASCENTS, target._replace(covariance=np.diag(np.repeat([1.0, 1.0], 3))))
    north = np.array([-np.sin(LATITUDE), 0.0, np.cos(LATITUDE)])
    across = np.sin(azimuth) * north - np.cos(azimuth) * np.array([0.0, 1.0, 0.0])
    assert abs((mean[:3] - site) @ across) < 30.0


@pytest.mark.parametrize(
    ("inland", "low_m", "high_m"), [(0.0, -120.0, 120.0), (1.0, 300.0, 1600.0)]
)
def test_sites_are_as_high_as_they_are_said_to_be(inland, low_m, high_m):
    site, target = in_flight((0.9, np.radians(9.0), 20.0, 0.006), 35.0)
    mean, covariance = launch_of(ASCENTS, target._replace(inland=inland))
    up = site / np.linalg.norm(site)
    assert low_m < (mean[:3] - site) @ up < high_m
    assert np.sqrt(up @ covariance[:3, :3] @ up) < 1.3e3


def test_a_launch_was_before_its_first_detection():
    """What scanners of 10 s have seen for 38 s was not launched 35 s ago, however fast it is."""
    looks = delays_at_once(
        np.array([10.0, 10.0]), np.array([0.9, 0.9]), np.ones((1, 2), dtype=np.bool_)
    )[0]
    _, target = in_flight((0.9, np.radians(9.0), 24.0, 0.006), 40.0)
    target = target._replace(at_once=looks)
    first, late = (
        launch_of(ASCENTS, target._replace(since_s=seen_s))[0][3] for seen_s in (2.0, 38.0)
    )
    assert late > max(first, 38.0)


def test_the_prior_of_a_first_detection_is_a_density_over_its_intervals():
    """What is not hidden counts with a share, as a histogram over the intervals; beyond the last
    edge it counts not.
    """
    _, target = in_flight((0.9, np.radians(9.0), 24.0, 0.006), 40.0)
    count = len(ASCENTS.log_weight)
    middle_s = 0.5 * (EDGES_S[1:] + EDGES_S[:-1])
    width_s = np.diff(EDGES_S)
    chance = np.random.default_rng(5).dirichlet(np.ones(len(width_s)))
    beyond = [(EDGES_S[-1], 0.0), (EDGES_S[-1] + 1.0, 0.0)]
    for first_s, density in [*zip(middle_s, chance / width_s, strict=True), *beyond]:
        densities = []
        for at_once in (chance, 1e-12 * chance):
            log = _log_prior(
                ASCENTS, np.full(count, first_s), np.zeros(count), target._replace(at_once=at_once)
            )
            densities.append(np.exp(log))
        assert densities[0] - densities[1] == pytest.approx(
            np.full(count, AT_ONCE * density), rel=1e-9, abs=1e-12
        )
    never = _log_prior(ASCENTS, np.full(count, -1.0), np.zeros(count), target)
    assert (never == -np.inf).all()


def test_of_what_no_boost_is_like_nothing_is_said():
    _, target = in_flight((0.9, np.radians(9.0), 20.0, 0.006), 35.0)
    deep = target._replace(state=np.append(target.state[:3], -7e3 * target.state[:3] / RADIUS_M))
    assert launch_of(ASCENTS, deep) is None
    far = target._replace(state=np.append(40.0 * target.state[:3], target.state[3:]))
    assert launch_of(ASCENTS, far) is None


def test_ascents_reach_a_height_when_they_are_there():
    height_m = np.full(len(ASCENTS.log_weight), 12e3)
    since_s = ASCENTS.reaching(height_m)
    height = AscentRows(*ASCENTS.at(since_s)[0]).height
    before = AscentRows(*ASCENTS.at(np.maximum(since_s - 6.0, 0.0))[0]).height
    never = since_s == LONGEST_S
    assert 0.0 < np.mean(never) < 0.2
    # What has dipped on its way up is where the lower step was.
    assert np.mean(np.abs(height[~never] - 12e3) < 1.0) > 0.99
    assert np.all(before[~never] < 12e3)
    assert np.all(ASCENTS.reaching(np.zeros_like(height_m)) == 0.0)


def test_a_kernel_and_a_regression_leave_the_moments_of_normal_variables():
    """What is hidden is twice what is seen, plus noise of 1: a closed form. 20 000 draws leave 2
    %.
    """
    rng = np.random.default_rng(3)
    truth = rng.normal(size=20_000)
    hidden = (2.0 * truth + rng.normal(size=20_000))[:, None]
    noise = np.array([[0.3**2]])
    seen_at = 0.7
    mean, covariance, samples = hidden_moments(
        truth[:, None] - seen_at, hidden, np.ones(1), noise, np.zeros(len(truth))
    )
    gain = 1.0 / (1.0 + noise[0, 0])
    assert mean[0] == pytest.approx(2.0 * gain * seen_at, abs=0.03)
    assert covariance[0, 0] == pytest.approx(1.0 + 4.0 * gain * noise[0, 0], rel=0.05)
    assert samples > 1000.0


def test_delays_are_of_launches_that_are_seen_at_once():
    assert SOON[EDGES_S[1:] < 2.0].sum() > 0.99
