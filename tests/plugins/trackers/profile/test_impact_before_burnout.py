"""No impact of a target that may burn on is told, whatever its class would do next, unless it is asked for."""

import numpy as np
import pytest
from attrs import evolve
from class_flights import watch_of
from off_model_flights import Flown, away_from, flown
from opir_trackers.configs import BoostProfileConfig
from opir_trackers.profile.seen import TrackHistory
from tracked_flights import followed, rows_of, usual

from opir_core.scoring.consistency import nees, on_normal_scale

SEED, AFTER_S = 41, 6

#: Half of the flights fly as their class does, half as no class does.
COURSES = ((0, "family"), (6, "tabulated"))


def seen_since(last_s, first_s=0.0, hits=400.0):
    """Return what sensors have seen of a track whose light came last at times (sensors,)."""
    last_s = np.atleast_2d(np.asarray(last_s, dtype=np.float64))
    shape = last_s.shape
    nothing = TrackHistory.nothing(np.arange(len(last_s)), shape[1])
    return evolve(
        nothing, first_s=np.full(shape, first_s), last_s=last_s, hits=np.tile(hits, (len(last_s), 1)) * np.ones(shape)
    )


def fared(truth, asked):
    """Return how ellipses of flights fare (ticks, flights), nan where none is told, and times after burns."""
    landed, found, after_s = truth.impacts(), [], []
    config, until_s = BoostProfileConfig(impacts_in_burn=asked), truth.burnout_s.max() + AFTER_S
    for tick in followed(truth, usual("SRBM"), SEED, until_s, config=config):
        rows = rows_of(tick.told, tick.shared)
        values, known = np.full(len(truth), np.nan), rows >= 0
        mine = tick.told.take(rows[known])
        spread = nees(away_from(mine.impact, landed[known]), mine.impact_covariance[:, :2, :2])
        values[known] = on_normal_scale(spread, mine.impact_sigmas)
        found.append(values)
        after_s.append(tick.time_s - truth.burnout_s)
    return np.stack(found), np.stack(after_s)


@pytest.mark.slow
def test_impacts_wait_for_the_end_of_burns_unless_they_are_asked_for():
    truth = Flown.concatenate([flown("SRBM", 12, SEED, name).take(slice(cut, cut + 6)) for cut, name in COURSES])
    values, after_s = fared(truth, False)
    assert np.isnan(values[after_s < 0.0]).all()
    assert np.isfinite(values[after_s > AFTER_S - 0.5]).all()
    asked, _ = fared(truth, True)
    early = np.isfinite(asked) & (after_s < 0.0)
    assert np.count_nonzero(early) > 10
    # What is told of targets that have burnt out does not depend on what was told before.
    both = np.isfinite(values)
    assert np.array_equal(values[both], asked[both])


@pytest.mark.parametrize(
    ("period_s", "chance", "time_since_last_s"), [(0.1, 0.8, 4.0), (1.0, 0.9, 4.0), (10.0, 0.9, 20.0)]
)
def test_silence_tells_the_end_of_a_burn_once_it_is_longer_than_chance_and_stages(period_s, chance, time_since_last_s):
    watch = watch_of(2, period_s=period_s, chance=chance)
    seen = seen_since([40.0, 40.0], hits=chance * 40.0 / period_s)
    assert not seen.are_out(40.0 + time_since_last_s - 0.1, watch)[0]
    assert seen.are_out(40.0 + time_since_last_s + 0.2, watch)[0]


def test_a_burn_goes_on_while_any_sensor_sees_it_and_a_sensor_that_failed_tells_nothing():
    watch = watch_of(2, period_s=1.0, chance=0.5)
    # One saw last 60 s ago and may have failed: of the other, that sees every other time, six missed looks are chance.
    one, both = seen_since([40.0, 100.0], hits=[20.0, 50.0]), seen_since([100.0, 100.0], hits=50.0)
    assert [bool(one.are_out(tick_s, watch)[0]) for tick_s in (101.0, 104.5, 106.5, 107.5)] == [False] * 3 + [True]
    assert [bool(both.are_out(tick_s, watch)[0]) for tick_s in (101.0, 103.9, 104.5)] == [False] * 2 + [True]


def test_sensors_that_follow_bodies_tell_no_end_of_a_burn_by_silence():
    watch = evolve(watch_of(2, period_s=0.1, chance=0.8), follows_bodies=np.array([True, True]))
    assert not seen_since([40.0, 40.0]).are_out(400.0, watch)[0]
