"""The range that one sensor does not see, by the law of boosts, on boosts that share no code with
it.
"""

import numpy as np
import pytest
from boost_law import ASCENTS
from opir_forecast.ascents import AscentRows
from opir_forecast.single_sight import Sighting, along_sight
from plain_boosts import RADIUS_M, flown

SENSOR = 4.2164e7 * np.array([np.cos(0.5), np.sin(0.5), 0.0])
MISSILES = slice(0, 1800)
LAUNCHERS = slice(2200, 2800)


def moments(target):
    return along_sight(ASCENTS, target, np.zeros((1, len(ASCENTS.log_weight))))


def sighting(start, state, since_s):
    """Return the line of sight to a state, and the sighting with an error of 200 m, 40 m/s and 5
    m/s².
    """
    line = state[:3] - SENSOR
    line /= np.linalg.norm(line)
    across = np.cross(line, state[:3])
    across /= np.linalg.norm(across)
    axes = np.stack([across, np.cross(across, line)])
    noise = np.diag(np.square(np.repeat([200.0, 40.0, 5.0, 40.0], 2)))
    return line, Sighting(
        SENSOR,
        start,
        200.0,
        RADIUS_M,
        since_s,
        SENSOR,
        np.zeros(3),
        state,
        axes,
        axes,
        np.zeros(2),
        noise,
    )


def at_burnout(columns):
    """Return the rows of some ascents when they last burn."""
    burnout = [np.flatnonzero(lit)[-1] for lit in ASCENTS.burns[:, columns].T]
    return AscentRows(*ASCENTS.path[burnout, :, np.arange(columns.start, columns.stop)].T)


def test_boosts_of_many_kinds_are_where_the_law_says():
    """Those that climb: a boost that a strong kick leads down again flies into the ground."""
    rng = np.random.default_rng(4)
    squared = []
    while len(squared) < 24:
        since_s = float(rng.uniform(30.0, 90.0))
        azimuth = rng.uniform(0.0, 6.28)
        kick = np.radians(rng.uniform(6.0, 20.0))
        force, growth = rng.uniform([15.0, 0.004], [25.0, 0.008])
        start, state = flown(azimuth, kick, force, growth, since_s)
        if state[:3] @ state[3:6] <= 0.0:
            continue
        line, target = sighting(start, state, since_s)
        result = moments(target)
        error = state.reshape(3, 3) @ line - result.mean
        squared.append(error @ np.linalg.solve(result.covariance, error) / 3.0)
    assert np.mean(np.array(squared) < 7.81 / 3.0) >= 0.9
    assert 0.3 < np.mean(squared) < 2.0


def seen_boost(azimuth, since_s):
    """Return the line of sight and the sighting of a boost with a medium kick."""
    start, state = flown(azimuth, np.radians(12.0), 20.0, 0.006, since_s)
    return sighting(start, state, since_s)


def test_the_longer_a_boost_lasts_the_less_is_known():
    widths = [
        np.sqrt(moments(seen_boost(1.0, since_s)[1]).covariance[0, 0])
        for since_s in (30.0, 60.0, 90.0)
    ]
    assert 300.0 < widths[0] < 4e3 < widths[2] < 60e3
    assert widths == sorted(widths)


def test_the_filters_own_range_is_not_used():
    line, target = seen_boost(2.0, 60.0)
    offset = np.outer([60e3, -900.0, 15.0], line).ravel()
    result = moments(target)
    moved = moments(target._replace(state=target.state + offset))
    slack = 0.2 * np.sqrt(result.covariance[0, 0])
    assert moved.mean[:2] == pytest.approx(result.mean[:2], rel=0.0, abs=slack)


def test_an_uncertain_first_line_makes_the_range_uncertain():
    _, target = seen_boost(2.0, 40.0)
    sure, unsure = (
        moments(target._replace(first_sigma_m=sigma_m)).covariance[0, 0] for sigma_m in (0.0, 5e3)
    )
    assert unsure > sure + 5e3**2


def test_after_every_burn_of_the_law_there_is_no_estimate():
    _, target = seen_boost(1.0, 60.0)
    assert moments(target._replace(since_s=710.0)) is None


def test_launchers_are_steered_to_heights_of_orbits():
    height = at_burnout(LAUNCHERS).height
    assert np.median(height) > 150e3
    assert np.mean(height < 450e3) > 0.9


def test_missiles_end_their_boosts_climbing_and_above_the_ground():
    """Those whose program leads into the ground look, until then, like boosts that climb less than
    any.
    """
    share = np.exp(ASCENTS.log_weight[MISSILES])
    rows = at_burnout(MISSILES)
    angle = np.degrees(np.arctan2(rows.climb, rows.level))
    crashes = rows.height < 200.0
    share /= share.sum()
    assert np.mean(crashes) > 0.1
    assert share[crashes].sum() < 0.01
    assert share[angle < 5.0].sum() < 0.1
    assert 25.0 < np.sort(angle)[np.searchsorted(np.cumsum(share[np.argsort(angle)]), 0.5)] < 55.0
