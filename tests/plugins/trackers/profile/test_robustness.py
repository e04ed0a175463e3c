"""What the tracker `boost-profile` makes of targets and lines of sight that are not what it takes for granted."""

import numpy as np
import pytest
from attrs import evolve
from class_flights import PRIORS, flights, lines_of_sight, watch_of
from off_model_flights import Flown, away_from, flown
from opir_trackers.profile import fit as profile_fit
from opir_trackers.profile import flight as profile_flight
from opir_trackers.profile.bank import Fitting
from opir_trackers.profile.family import SIZE
from opir_trackers.profile.rows import Rows
from opir_trackers.profile.seen import FIRST_STRANGE, LEAN_VARIANCE, TrackHistory
from opir_trackers.profile.strain import KEPT, TURNS, OffModelFilters, judged
from opir_trackers.profile.trust import apart, blended, chances, typed
from tracked_flights import followed, last_told, rows_of, usual

from opir_core.flight import Drag, Forces, propagate
from opir_core.geometry import ecef_to_eci_state, eci_to_ecef_state
from opir_core.interfaces.records import Tracks
from opir_core.scene.scene import TARGET_TYPES, UNKNOWN_TYPE
from opir_core.scoring.consistency import nees


def rows_at(time_s, sensors, tracks=1):
    """Return rows of tracks, one a sensor and time (t,), in order of time."""
    track, when, sensor = (
        grid.ravel() for grid in np.meshgrid(np.arange(tracks), time_s, np.arange(sensors), indexing="ij")
    )
    count, none = len(track), np.zeros((len(track), 3))
    return Rows(track, when, sensor.astype(np.int32), none, np.zeros((count, 3, 3)), np.full(count, 2e-5))


def odds_of(innovation):
    """Return the log odds (tracks, ticks) told by innovations (tracks, ticks, sensors, 2)."""
    tracks, ticks, sensors, _ = innovation.shape
    known, told = TrackHistory.nothing(np.arange(tracks), sensors), []
    for tick in range(ticks):
        rows = rows_at([float(tick)], sensors, tracks)
        known = judged(known, rows, innovation[:, tick].reshape(-1, 2))
        told.append(known.strange)
    return np.stack(told, axis=1)


def test_white_innovations_call_few_targets_strange_and_leaning_ones_all():
    rng = np.random.default_rng(1)
    white = rng.normal(size=(2000, 60, 2, 2))
    odds = odds_of(white)
    # By Ville's inequality odds of 1 are exceeded by less than what they begin with and gain from turning strange.
    bound = np.exp(FIRST_STRANGE) + 60 * TURNS
    assert np.mean(odds.max(axis=1) > 0.0) < bound + 3.3 * np.sqrt(bound / 2000)
    leaning = odds_of(white + np.array([1.0, -0.7]))
    assert np.mean(leaning[:, -1] > 0.0) > 0.99
    assert np.mean(odds_of(white + np.where(np.arange(60) < 45, 0.0, 1.2)[:, None, None])[:, -1] > 0.0) > 0.9


def test_odds_are_those_of_the_process_they_stand_for():
    from scipy.stats import multivariate_normal

    innovation = np.random.default_rng(2).normal(size=(1, 6, 1, 2))
    lag = np.abs(np.subtract.outer(np.arange(6), np.arange(6)))
    leaning = multivariate_normal(np.zeros(6), np.eye(6) + LEAN_VARIANCE * KEPT**lag)
    white, expected = multivariate_normal(np.zeros(6), np.eye(6)), FIRST_STRANGE
    for axis in range(2):
        expected += leaning.logpdf(innovation[0, :, 0, axis]) - white.logpdf(innovation[0, :, 0, axis])
    told = odds_of(innovation)[0, -1]
    # What turning strange adds is little at each tick.
    assert expected < told < expected + np.log1p(6 * TURNS / np.exp(FIRST_STRANGE) * 3.0)


@pytest.mark.parametrize(("pause_s", "strange"), [(0.4, False), (1.2, True)])
def test_light_that_comes_back_after_a_pause_of_all_sensors_is_a_stage(pause_s, strange):
    watch = watch_of(2, period_s=0.1, chance=0.6)
    looks = 0.1 * np.arange(1, 101)
    early = rows_at(looks, 2)
    early = early.take(np.flatnonzero(np.random.default_rng(3).random(len(early)) < 0.6))
    known = TrackHistory.nothing(np.zeros(0, dtype=np.int64), 2).with_rays(early, early.time_s)
    late = rows_at([early.time_s.max() + pause_s], 2)
    after = known.with_rays(late, late.time_s).paused(known, late, watch)
    assert (after.strange[0] > FIRST_STRANGE + 4.0) == strange
    one = late.take(np.flatnonzero(late.sensor == 0))
    only = known.take(slice(None))
    only.last_s[0, 1] += pause_s
    again = only.with_rays(one, one.time_s).paused(only, one, watch)
    assert again.strange[0] == FIRST_STRANGE


def test_a_pause_is_not_forgotten_however_white_the_innovations_after_it_are():
    watch, looks = watch_of(2, period_s=0.1, chance=0.8), 0.1 * np.arange(1, 101)
    early, late = rows_at(looks, 2), rows_at([looks[-1] + 1.2], 2)
    known = TrackHistory.nothing(np.zeros(0, dtype=np.int64), 2).with_rays(early, early.time_s)
    known = known.with_rays(late, late.time_s).paused(known, late, watch)
    told = known.otherwise[0]
    assert told > 2.0
    rng = np.random.default_rng(5)
    for tick in range(120):
        known = judged(known, rows_at([20.0 + tick], 2), rng.normal(size=(2, 2)))
    assert known.strange[0] < told - 3.0
    # One flight in three with a pause is fitted on: by a third the odds at the pause were larger than the others alone.
    assert told - np.log(4.0) - 1e-9 < known.otherwise[0] < told - 0.5
    # A flight without a pause has no odds beside those of its innovations.
    white = TrackHistory.nothing(np.zeros(1, dtype=np.int64), 2)
    assert white.otherwise[0] == FIRST_STRANGE


def pair_of_tracks(rng, count):
    """Return fitted and filtered tracks of so many targets."""

    def spread(size, scale):
        side = rng.normal(size=(count, size, size))
        return (side @ side.transpose(0, 2, 1) + np.eye(size)) * np.outer(scale, scale)

    metres, place = np.array([300.0] * 3 + [30.0] * 3), np.array([5e3, 5e3, 10.0])
    ground = np.array([0.6, 0.2, 400.0]) + 1e-3 * rng.normal(size=(count, 3))
    whole = Tracks(
        tick_s=np.full(count, 80.0),
        track=np.arange(count),
        state=metres * rng.normal(size=(count, 6)),
        state_covariance=spread(6, metres),
        launch=ground,
        launch_covariance=spread(3, place),
        impact=ground,
        impact_covariance=spread(3, place),
        type_probability=np.full((count, 4), 0.25),
        burnout=np.zeros((count, 7)),
        burnout_covariance=np.tile(np.eye(7), (count, 1, 1)),
    )
    moved = ground + 5e-4 * rng.normal(size=(count, 3))
    state = whole.state + 2.0 * metres * rng.normal(size=(count, 6))
    return whole, evolve(whole, state=state, state_covariance=spread(6, metres), impact=moved)


def test_a_mixture_has_the_moments_of_its_parts():
    fitted, filtered = pair_of_tracks(np.random.default_rng(4), 3)
    chance = np.array([0.3, 0.5, 0.8])
    told = blended(fitted, filtered, chance, np.full(3, 9.0))
    for row in range(3):
        x, y, p = fitted.state[row], filtered.state[row], chance[row]
        second = (1.0 - p) * (fitted.state_covariance[row] + np.outer(x, x))
        second += p * (filtered.state_covariance[row] + np.outer(y, y))
        mean = (1.0 - p) * x + p * y
        assert told.state[row] == pytest.approx(mean)
        assert told.state_covariance[row] == pytest.approx(second - np.outer(mean, mean), rel=1e-6, abs=1e-6)
    for covariance in (told.state_covariance, told.impact_covariance, told.launch_covariance):
        assert np.linalg.eigvalsh(covariance).min() > 0.0


def test_a_fit_that_is_the_sure_part_of_what_the_filter_knows_is_trusted_and_one_far_from_it_is_not():
    rng, count = np.random.default_rng(8), 4000
    fitted, filtered = pair_of_tracks(rng, count)
    more = filtered.state_covariance
    filtered = evolve(filtered, state_covariance=fitted.state_covariance + more)
    off = np.linalg.cholesky(more) @ rng.normal(size=(count, 6, 1))
    right = evolve(filtered, state=fitted.state + off[:, :, 0])
    # χ² of six degrees of freedom exceeds 12 ln 8 = 24.95 once in 2 900; five or more of 4 000 are one case in 70.
    assert np.count_nonzero(apart(fitted, right)) < 8
    axis = np.linalg.cholesky(filtered.state_covariance)[:, :, 0]
    wrong = evolve(filtered, state=fitted.state + 8.0 * axis)
    # What the two differ by is no less certain than the filter is.
    gain = apart(fitted, wrong)
    assert np.all(gain == 12.0)
    near = evolve(filtered, state=fitted.state + 5.5 * axis)
    assert np.all(apart(fitted, near) > 0.5 * 5.5**2 - 6.0 * np.log(8.0) - 1e-6)


def test_small_chances_count_for_nothing_and_need_be_larger_of_what_one_sensor_sees():
    chance = np.array([0.05, 0.15, 0.3, 0.05, 0.15, 0.3])
    told = chances(np.log(chance / (1.0 - chance)), np.array([False] * 3 + [True] * 3))
    assert told == pytest.approx([0.0, 0.15, 0.3, 0.0, 0.0, 0.3])


def test_certain_chances_tell_one_of_the_two():
    fitted, filtered = pair_of_tracks(np.random.default_rng(5), 2)
    told = blended(fitted, filtered, np.array([0.0, 1.0]), np.full(2, 9.0))
    assert told.state[0] == pytest.approx(fitted.state[0])
    assert told.state[1] == pytest.approx(filtered.state[1])
    assert told.impact[1] == pytest.approx(filtered.impact[1])
    assert np.isfinite(told.burnout[0]).all()
    assert np.isnan(told.burnout[1]).all()


def test_radii_of_ellipses_are_told_where_nothing_is_mixed_in():
    fitted, filtered = pair_of_tracks(np.random.default_rng(9), 5)
    radii = np.array([0.8, 1.9, 2.6])
    fitted = evolve(fitted, impact_sigmas=np.tile(radii, (5, 1)))
    filtered.impact[[3, 4]] = np.nan
    told = blended(fitted, filtered, np.array([0.0, 0.3, 0.9, 0.3, 0.9]), np.full(5, 9.0))
    for row, is_kept in enumerate((True, False, False, True, False)):
        assert told.impact_sigmas[row] == pytest.approx(radii if is_kept else np.full(3, np.nan), nan_ok=True)


def test_a_strange_target_that_may_light_another_stage_has_no_impact():
    fitted, filtered = pair_of_tracks(np.random.default_rng(6), 2)
    told = blended(fitted, filtered, np.array([0.9, 0.9]), np.array([1.0, 9.0]))
    assert np.isnan(told.impact[0]).all()
    assert np.isfinite(told.impact[1]).all()


def test_what_one_knows_and_the_other_does_not_is_told_of_the_likelier():
    fitted, filtered = pair_of_tracks(np.random.default_rng(7), 2)
    filtered.impact[...] = np.nan
    told = blended(fitted, filtered, np.array([0.3, 0.7]), np.full(2, 9.0))
    assert told.impact[0] == pytest.approx(fitted.impact[0])
    assert np.isnan(told.impact[1]).all()


def test_types_are_mixed_as_all_else_is():
    fitted, filtered = pair_of_tracks(np.random.default_rng(8), 3)
    fitted = evolve(fitted, type_probability=np.tile([1.0, 0.0, 0.0, 0.0], (3, 1)))
    filtered = evolve(filtered, type_probability=np.tile([0.0, 0.0, 0.0, 1.0], (3, 1)))
    told = blended(fitted, filtered, np.array([0.0, 0.3, 1.0]), np.full(3, 9.0)).type_probability
    assert told == pytest.approx(np.array([[1.0, 0.0, 0.0, 0.0], [0.7, 0.0, 0.0, 0.3], [0.0, 0.0, 0.0, 1.0]]))


def test_how_far_a_stranger_flies_tells_its_type_beside_what_sensors_report():
    _, filtered = pair_of_tracks(np.random.default_rng(8), 4)
    away_rad = np.array([300e3, 8000e3, np.nan, 8000e3]) / 6.371e6
    filtered.launch[:, :2], filtered.impact[:, 0], filtered.impact[:, 1] = 0.0, 0.0, away_rad
    silent, sure = np.eye(4)[UNKNOWN_TYPE], np.array([1e-6, 1e-6, 1.0 - 2e-6, 0.0])
    told = typed(evolve(filtered, type_probability=np.stack([silent, silent, silent, sure]))).type_probability
    assert told.sum(axis=1) == pytest.approx(np.ones(4))
    likeliest = [TARGET_TYPES[row.argmax()] for row in told[:2]]
    assert likeliest == ["SRBM", "ICBM"]
    assert told[:2].max(axis=1).min() > 0.95
    assert told[2] == pytest.approx(silent)
    # Reports as sure as this outweigh a range, which rules nothing out.
    assert told[3, TARGET_TYPES.index("ICBM")] < 0.01


def test_only_what_two_sensors_see_is_certainly_strange():
    known = evolve(TrackHistory.nothing(np.arange(3), 2), strange=np.array([12.0, 14.0, 14.0]))
    known.hits[...] = [[9.0, 9.0], [9.0, 9.0], [9.0, 0.0]]
    assert known.strangers().tolist() == [1]


@pytest.mark.slow
def test_certain_strangers_cost_no_fit_and_are_told_as_the_filter_tells_them(monkeypatch):
    fitted, plain = [], Fitting._fitted

    def counted(self, bank, fresh, tick_s):
        fitted.append(len(np.unique(bank.hypotheses.track)))
        return plain(self, bank, fresh, tick_s)

    monkeypatch.setattr(Fitting, "_fitted", counted)
    truth = flown("ICBM", 4, 31, "staged")
    *_, last = followed(truth, usual("ICBM"), 31, truth.burnout_s.max() + 6.0)
    rows = rows_of(last.told, last.shared)
    assert fitted[5] == 4
    assert fitted[-1] == 0
    assert np.array_equal(last.told.state[rows], last.filtered.state[rows])
    assert (last.told.type_probability[rows, TARGET_TYPES.index("ICBM")] > 0.9).all()


@pytest.mark.slow
def test_impact_ellipses_hold_targets_of_other_families():
    staged, tabulated = (flown("SRBM", 24, 21, course) for course in ("staged", "tabulated"))
    truth = Flown.concatenate([staged.take(slice(0, 12)), tabulated.take(slice(12, 24))])
    told = last_told(truth, usual("SRBM"), 21, 6.0)
    values = nees(away_from(told.impact, truth.impacts()), told.impact_covariance[:, :2, :2])
    # 24 draws that are held with 90 %: fewer than 16 are a case of one in three thousand.
    assert np.count_nonzero(values < 5.99) >= 16


@pytest.mark.slow
def test_impact_ellipses_hold_where_three_lines_of_sight_in_ten_stray_within_the_gate():
    truth = flown("SRBM", 12, 22, "family")
    told = last_told(truth, usual("SRBM")._replace(outliers=0.3, astray_rad=9e-5), 22, 6.0)
    values = nees(away_from(told.impact, truth.impacts()), told.impact_covariance[:, :2, :2])
    # 12 draws that are held with 90 %: fewer than 7 are a case of one in a thousand.
    assert np.count_nonzero(values < 5.99) >= 7


def test_states_after_the_burn_are_under_the_forces_of_the_scene():
    truth, forces = flights("SRBM", 6, 2), Forces(("j2",), Drag(5000.0))
    family, none = profile_fit.family_of(truth, PRIORS), np.zeros((6, SIZE, SIZE))
    ends, slope = profile_flight.burnouts(family, none)
    tick_s = float(family.burnout_s.max()) + 25.0
    told = profile_flight.states(family, none, tick_s, ends, slope, forces).mean
    inertial = ecef_to_eci_state(ends.mean[:, :3], ends.mean[:, 3:6], ends.mean[:, 6])
    flown_ = propagate(*inertial, tick_s - ends.mean[:, 6], forces)
    expected = np.concatenate(eci_to_ecef_state(*flown_, np.full(6, tick_s)), axis=1)
    assert np.abs(told - expected).max() < 1.0
    two_body = profile_flight.states(family, none, tick_s, ends, slope).mean
    assert np.abs(two_body - expected)[:, :3].max() > 30.0


@pytest.mark.slow
def test_biases_that_sensors_tell_of_make_no_target_strange():
    truth = flights("SRBM", 8, 23)
    track, rays = lines_of_sight(truth, 2e-5, 23, biases_rad=6e-5)
    odds = []
    for told_rad in (6e-5, 0.0):
        fitting, bank, cut = Fitting(PRIORS, watch_of(2, bias_sigma_rad=told_rad), True), OffModelFilters.empty(2), 0
        for tick in range(1, 36):
            end = int(np.searchsorted(rays.time_s, tick))
            bank = fitting.stepped(bank, float(tick), track[cut:end], rays.take(slice(cut, end)))
            cut = end
        odds.append(bank.seen.strange)
    # Each of eight is called strange by chance once in twenty: four or more are a case of one in a thousand.
    assert np.count_nonzero(odds[0] > 0.0) < 4
    assert np.count_nonzero(odds[1] > 0.0) > 4
