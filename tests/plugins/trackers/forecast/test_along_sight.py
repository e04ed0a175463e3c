"""What the law of boosts says of the range that one sensor does not see, on boosts that share no
code with it.
"""

import numpy as np
import pytest
from opir_trackers.forecast.along_sight import Sighting, along_sight
from opir_trackers.forecast.ascents import AscentRows, ascents_of
from opir_trackers.forecast.outcomes import Outcomes
from opir_trackers.forecast.vehicles import vehicle_model
from plain_boosts import RADIUS_M, flown

from opir_core.scene import core_hypotheses

ASCENTS = ascents_of(Outcomes(vehicle_model(), core_hypotheses()))
SENSOR = 4.2164e7 * np.array([np.cos(0.5), np.sin(0.5), 0.0])
MISSILES = slice(0, 1800)
LAUNCHERS = slice(2200, 2800)
AT_ONCE = np.zeros((1, len(ASCENTS.log_weight)))


def sighting(start, state, since_s):
    """Return what the sensor sees of a state, with an error of 200 m, 40 m/s and 5 m/s²."""
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
    last = [np.flatnonzero(lit)[-1] for lit in ASCENTS.burns[:, columns].T]
    return AscentRows(*ASCENTS.path[last, :, np.arange(columns.start, columns.stop)].T)


def hidden(line, state):
    return state.reshape(3, 3) @ line


def test_boosts_of_many_kinds_are_where_the_law_says():
    """Those that climb: what a strong kick leads down again flies into the ground, and is no
    boost.
    """
    rng = np.random.default_rng(4)
    squared = []
    while len(squared) < 24:
        since_s = float(rng.uniform(30.0, 90.0))
        boost = rng.uniform(0.0, 6.28), np.radians(rng.uniform(6.0, 20.0)), rng.uniform(15.0, 25.0)
        start, state = flown(*boost, rng.uniform(0.004, 0.008), since_s)
        if state[:3] @ state[3:6] <= 0.0:
            continue
        line, seen = sighting(start, state, since_s)
        found = along_sight(ASCENTS, seen, AT_ONCE)
        error = hidden(line, state) - found.mean
        squared.append(error @ np.linalg.solve(found.covariance, error) / 3.0)
    assert np.mean(np.array(squared) < 7.81 / 3.0) >= 0.9
    assert 0.3 < np.mean(squared) < 2.0


def test_the_longer_a_boost_lasts_the_less_is_known():
    widths = []
    for since_s in (30.0, 60.0, 90.0):
        start, state = flown(1.0, np.radians(12.0), 20.0, 0.006, since_s)
        widths.append(
            np.sqrt(
                along_sight(ASCENTS, sighting(start, state, since_s)[1], AT_ONCE).covariance[0, 0]
            )
        )
    assert 300.0 < widths[0] < 4e3 < widths[2] < 60e3
    assert widths == sorted(widths)


def test_the_filters_own_range_is_not_used():
    start, state = flown(2.0, np.radians(12.0), 20.0, 0.006, 60.0)
    line, seen = sighting(start, state, 60.0)
    off = state + np.concatenate([60e3 * line, -900.0 * line, 15.0 * line])
    first, other = (
        along_sight(ASCENTS, each, AT_ONCE) for each in (seen, seen._replace(state=off))
    )
    assert np.abs(first.mean - other.mean)[:2] == pytest.approx(
        [0.0, 0.0], abs=0.2 * np.sqrt(first.covariance[0, 0])
    )


def test_an_uncertain_first_line_makes_the_range_uncertain():
    start, state = flown(2.0, np.radians(12.0), 20.0, 0.006, 40.0)
    _, seen = sighting(start, state, 40.0)
    sure, unsure = (
        along_sight(ASCENTS, seen._replace(first_sigma_m=sigma_m), AT_ONCE).covariance[0, 0]
        for sigma_m in (0.0, 5e3)
    )
    assert unsure > sure + 5e3**2


def test_after_every_burn_of_the_law_nothing_is_said():
    start, state = flown(1.0, np.radians(12.0), 20.0, 0.006, 60.0)
    assert along_sight(ASCENTS, sighting(start, state, 710.0)[1], AT_ONCE) is None


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
    near = rows.height < 200.0
    share /= share.sum()
    assert np.mean(near) > 0.1
    assert share[near].sum() < 0.01
    assert share[angle < 5.0].sum() < 0.1
    assert 25.0 < np.sort(angle)[np.searchsorted(np.cumsum(share[np.argsort(angle)]), 0.5)] < 55.0
