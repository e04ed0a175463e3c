"""States of `imm` on ascents that share no code with it: throttled stages, long second ones, burns
that fly back.
"""

import numpy as np
import pytest
from drawn_ascents import ascents
from drawn_flights import Seeing
from tracked_flights import followed, rows_of, sensors_of

pytestmark = pytest.mark.slow

#: Largest squared normalised error of six numbers in a 95 % region.
HELD = 12.59
SEEING = Seeing(period_s=0.1, sigma_rad=20e-6, chance=0.72)


def held(kind, count, seed, marks, sensors=2):
    """Return by mark, as (burn, edge, seconds after it), which states (flights,) are in their 95 %
    regions.
    """
    truth, burns = ascents(kind, count, seed)
    marks_s = {mark: np.ceil(burns[:, mark[0], mark[1]] + mark[2]) for mark in marks}
    result = {mark: np.zeros(len(truth), dtype=bool) for mark in marks}
    until_s = max(times_s.max() for times_s in marks_s.values())
    some = sensors_of()[:sensors]
    for tick in followed(truth, SEEING, seed, until_s, some, forecast="none"):
        for mark, when in marks_s.items():
            for flight in np.flatnonzero(when == tick.time_s):
                row = rows_of(tick.reported, tick.shared)[flight]
                error = tick.reported.state[row] - truth.states(tick.time_s)[flight]
                squared = error @ np.linalg.solve(tick.reported.state_covariance[row], error)
                result[mark][flight] = row >= 0 and squared < HELD
    return result


def test_a_stage_that_flies_back_is_followed():
    """Thrust along the velocity alone held 70 % of these (20 s into a burn of 30 to 60 s)."""
    result = held("boostback", 16, 8, marks := [(0, 1, 5.0), (1, 0, 20.0), (1, 1, 5.0)])
    assert len(result[marks[0]]) >= 14
    for mark in marks:
        assert np.mean(result[mark]) >= 0.85, mark


def test_a_second_stage_after_a_long_gap_is_new():
    result = held("long gap", 16, 8, marks := [(0, 1, 20.0), (1, 0, 3.0), (1, 0, 10.0)])
    assert len(result[marks[0]]) >= 14
    for mark in marks:
        assert np.mean(result[mark]) >= 0.85, mark


def test_three_stages_are_followed_by_one_sensor():
    """The prior of a track knew no up: 75 % were held, and tracks sank below the ground."""
    result = held("three", 48, 8, marks := [(1, 0, 30.0), (2, 0, 30.0), (2, 1, 5.0)], sensors=1)
    for mark in marks:
        assert np.mean(result[mark]) >= 0.85, mark
