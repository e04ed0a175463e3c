"""Time and place of the launch of a target in flight, by the law of boosts, on boosts that share no
code with it.
"""

import numpy as np
import pytest
from boost_law import ASCENTS
from opir_forecast.ascents import LONGEST_S, AscentRows
from opir_forecast.kernel_regression import hidden_moments
from opir_forecast.launch_points import AT_ONCE, EDGES_S, delays_at_once, log_unreported
from opir_forecast.since_launch import InFlight, _log_prior, launch_of
from plain_boosts import RADIUS_M, flown

from opir_core.geometry import geodetic_to_ecef


def delays(period_s, probabilities):
    """Return the prior of the delays of two sensors that see a launch."""
    sees = np.ones((1, 2), dtype=np.bool_)
    return delays_at_once(log_unreported(np.full(2, period_s), np.array(probabilities)), sees)[0]


SOON = delays(0.1, [0.6, 0.7])
SIGMA = np.repeat([150.0, 40.0], 3)
LATITUDE = 0.7


def in_flight(azimuth, kick_deg, force, since_s, noise=0.0):
    """Return the site of a boost, on the ellipsoid, and the target as two sensors see it after a
    time.
    """
    start, state = flown(azimuth, np.radians(kick_deg), force, 0.006, since_s, LATITUDE)
    site = geodetic_to_ecef(LATITUDE, 0.0, 0.0)
    state = np.concatenate([site + state[:3] - start, state[3:6]]) + SIGMA * noise
    return site, InFlight(state, np.diag(SIGMA**2), 5.0, SOON, 0.5)


def test_launches_of_many_kinds_were_when_and_where_the_law_says():
    """Their forces, pitch-overs and headings are not its draws; the time is unknown to a fifth of
    itself.
    """
    rng = np.random.default_rng(5)
    squared = []
    delays_s = []
    while len(squared) < 40:
        since_s, azimuth, kick_deg, force = rng.uniform(
            [25.0, 0.0, 4.0, 14.0], [70.0, 6.28, 14.0, 26.0]
        )
        site, target = in_flight(azimuth, kick_deg, force, since_s, rng.standard_normal(6))
        if target.state[:3] @ target.state[3:] <= 0.0:
            continue
        mean, covariance = launch_of(ASCENTS, target)
        error = mean - np.append(site, since_s)
        squared.append(error @ np.linalg.solve(covariance, error) / 4.0)
        delays_s.append(error[3] / since_s)
        assert np.linalg.norm(error[:3]) < 0.2 * np.linalg.norm(target.state[:3] - site) + 2e3
    assert np.mean(np.array(squared) < 9.49 / 4.0) >= 0.9
    assert 0.2 < np.mean(squared) < 1.5
    assert np.sqrt(np.mean(np.square(delays_s))) < 0.25


def test_the_place_is_known_across_the_heading_better_than_along_it():
    site, target = in_flight(0.9, 9.0, 20.0, 50.0)
    _, covariance = launch_of(ASCENTS, target)
    up = site / np.linalg.norm(site)
    level = target.state[3:] - (target.state[3:] @ up) * up
    heading = level / np.linalg.norm(level)
    along, across = (
        np.sqrt(axis @ covariance[:3, :3] @ axis) for axis in (heading, np.cross(up, heading))
    )
    assert 300.0 < across < 0.7 * along


@pytest.mark.parametrize("azimuth", [0.0, 2.0, 4.0])
def test_the_earth_turns_below_a_flight(azimuth):
    """A minute after the launch, 28 km away: unless the turn of the heading counts, the place is
    off by over 30 m.
    """
    site, target = in_flight(azimuth, 12.0, 22.0, 60.0)
    mean, _ = launch_of(ASCENTS, target._replace(covariance=np.eye(6)))
    north = np.array([-np.sin(LATITUDE), 0.0, np.cos(LATITUDE)])
    across = np.sin(azimuth) * north - np.cos(azimuth) * np.array([0.0, 1.0, 0.0])
    assert abs((mean[:3] - site) @ across) < 30.0


@pytest.mark.parametrize(
    ("inland", "low_m", "high_m"), [(0.0, -120.0, 120.0), (1.0, 300.0, 1600.0)]
)
def test_sites_are_as_high_as_they_are_said_to_be(inland, low_m, high_m):
    site, target = in_flight(0.9, 9.0, 20.0, 35.0)
    mean, covariance = launch_of(ASCENTS, target._replace(inland=inland))
    up = site / np.linalg.norm(site)
    assert low_m < (mean[:3] - site) @ up < high_m
    assert np.sqrt(up @ covariance[:3, :3] @ up) < 1.3e3


def test_a_launch_was_before_its_first_detection():
    """A target that scanners of 10 s have seen for 38 s was not launched 35 s ago, however fast."""
    _, target = in_flight(0.9, 9.0, 24.0, 40.0)
    target = target._replace(at_once=delays(10.0, [0.9, 0.9]))
    short_s, long_s = (
        launch_of(ASCENTS, target._replace(since_s=seen_s))[0][3] for seen_s in (2.0, 38.0)
    )
    assert long_s > max(short_s, 38.0)


def test_the_prior_of_a_first_detection_is_a_density_over_its_intervals():
    """Visible launches count with a share, as a histogram over the intervals; beyond the last edge
    they do not count.
    """
    _, target = in_flight(0.9, 9.0, 24.0, 40.0)
    count = len(ASCENTS.log_weight)

    def density(first_s, at_once):
        log = _log_prior(
            ASCENTS, np.full(count, first_s), np.zeros(count), target._replace(at_once=at_once)
        )
        return np.exp(log)

    width_s = np.diff(EDGES_S)
    chance = np.random.default_rng(5).dirichlet(np.ones(len(width_s)))
    end_s = EDGES_S[-1]
    times_s = [*(EDGES_S[:-1] + 0.5 * width_s), end_s, end_s + 1.0]
    for first_s, expected in zip(times_s, [*(chance / width_s), 0.0, 0.0], strict=True):
        visible = density(first_s, chance) - density(first_s, 1e-12 * chance)
        assert visible == pytest.approx(np.full(count, AT_ONCE * expected), rel=1e-9, abs=1e-12)
    assert not density(-1.0, target.at_once).any()


@pytest.mark.parametrize(("radius", "climb_m_s"), [(1.0, -7e3), (40.0, 0.0)])
def test_a_target_unlike_any_boost_has_no_launch(radius, climb_m_s):
    _, target = in_flight(0.9, 9.0, 20.0, 35.0)
    place = target.state[:3]
    velocity = climb_m_s * place / RADIUS_M if climb_m_s else target.state[3:]
    state = np.append(radius * place, velocity)
    assert launch_of(ASCENTS, target._replace(state=state)) is None


def test_ascents_reach_a_height_when_they_are_there():
    def heights(times_s):
        return AscentRows(*ASCENTS.at(times_s)[0]).height[reach]

    height_m = np.full(len(ASCENTS.log_weight), 12e3)
    since_s = ASCENTS.reaching(height_m)
    reach = since_s < LONGEST_S
    assert 0.8 < np.mean(reach) < 1.0
    # An ascent that has dipped on its way up is where the lower step was.
    assert np.mean(np.abs(heights(since_s) - 12e3) < 1.0) > 0.99
    assert np.all(heights(np.maximum(since_s - 6.0, 0.0)) < 12e3)
    assert not ASCENTS.reaching(np.zeros_like(height_m)).any()


def test_a_kernel_and_a_regression_leave_the_moments_of_normal_variables():
    """The hidden variable is twice the measured one, plus noise of 1: a closed form. 20 000 draws
    leave 2 %.
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
