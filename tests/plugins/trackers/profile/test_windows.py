"""Windows through which `boost-profile` sees a lean: when they are laid anew, and when their sum is one hypothesis."""

import numpy as np
import pytest
from attrs import evolve
from class_flights import PRIORS, bank_after, flights, hidden, lines_of_sight, watch_of
from opir_trackers.profile import fit
from opir_trackers.profile.bank import Fitting
from opir_trackers.profile.family import BURN, SIZE, START, TURN_EAST, TURN_NORTH
from opir_trackers.profile.fit import SPACING
from opir_trackers.profile.hypotheses import GIVEN_UP, probability
from opir_trackers.profile.windows import anew, laid, straightened, windowed

from opir_core.scene.scene import TARGET_TYPES

#: The lean of all ridges here, rad, and how well it is known along them.
LEAN_RAD, ALONG_RAD = 0.7, 0.1


def ridge(width, across_rad, middles=range(-8, 9)):
    """Return hypotheses through windows on a lean that is normal and straight: to the north, known east and west.

    `width` is that of windows over `ALONG_RAD`, and `middles` where they lie, over their distance.
    """
    window = width * ALONG_RAD
    place = window * SPACING * np.array([*middles], dtype=float)
    count, known = len(place), np.array([50.0, 50.0, 0.5, 1.0, across_rad, 0.02, 0.05, 0.05, 0.1, 0.2])
    through = np.column_stack([np.ones(count), np.zeros(count), place, np.full(count, window**-2)])
    return settled(
        evolve(
            fit.blank(count, 1),
            spread=np.tile(np.diag(np.square(known)), (count, 1, 1)),
            window=through,
            is_bent=np.ones(count, dtype=np.int64),
            kind=np.ones(count, dtype=np.int64),
        )
    )


def settled(hypotheses):
    """Return hypotheses with the moments and the evidence of the normal curve times their windows, where not given up.

    What lies along is east of where the mean is, whichever way the line was laid.
    """
    place, window = hypotheses.window[:, 2] * np.sign(hypotheses.window[:, 0]), 1.0 / hypotheses.window[:, 3]
    whole = ALONG_RAD**2 + window
    parameters, spread = np.zeros_like(hypotheses.parameters), hypotheses.spread.copy()
    parameters[:, TURN_EAST], parameters[:, TURN_NORTH] = place * ALONG_RAD**2 / whole, LEAN_RAD
    spread[:, TURN_EAST, TURN_EAST] = ALONG_RAD**2 * window / whole
    found = evolve(hypotheses, parameters=parameters, spread=spread, evidence=-0.5 * place**2 / whole)
    return found.take(np.flatnonzero(probability(found) > GIVEN_UP))


@pytest.mark.parametrize("width", [0.5, 0.7, 0.9])
def test_windows_that_hold_a_whole_ridge_stay_as_they_are(width):
    whole = ridge(width, 0.05)
    again, fresh = laid(whole, PRIORS)
    assert not fresh.any()
    assert np.array_equal(again.window, whole.window)


@pytest.mark.parametrize("width", [0.5, 0.7, 0.9])
@pytest.mark.parametrize("side", [1, -1])
def test_windows_are_laid_anew_where_one_that_is_not_there_would_hold_much(width, side):
    half = ridge(width, 0.05, [side * step for step in range(-8, 1)])
    again, fresh = laid(half, PRIORS)
    assert fresh.all()
    again, _ = laid(settled(again), PRIORS)
    assert np.max(side * again.window[:, 2] * np.sign(again.window[:, 0])) > 2.0 * ALONG_RAD


def test_windows_laid_anew_leave_other_headings_where_they_are():
    ridges = ridge(1.5, 0.05)
    # Three in a thousand lean the other way.
    other = ridges.take(np.array([np.argmax(ridges.evidence)]))
    west = evolve(
        other,
        parameters=other.parameters - 12.0 * ALONG_RAD * np.eye(SIZE)[TURN_EAST],
        window=other.window - 12.0 * ALONG_RAD * np.eye(4)[2],
        evidence=other.evidence + np.log(0.003),
    )
    both = type(ridges).concatenate([ridges, west])
    again, fresh = laid(both, PRIORS)
    assert fresh.sum() == 9
    assert again.take(np.flatnonzero(~fresh)).parameters.tolist() == west.parameters.tolist()


def test_windows_laid_anew_hold_burns_that_the_class_has():
    """Far from its rows a fit may take a burn to go with the lean by many times what the class allows."""
    steep = ridge(1.5, 0.05)
    spread = steep.spread.copy()
    spread[:, BURN] += 400.0 * spread[:, TURN_EAST]
    spread[:, :, BURN] += 400.0 * spread[:, :, TURN_EAST]
    again, fresh = laid(evolve(steep, spread=spread), PRIORS)
    assert fresh.any()
    prior = PRIORS.take(again.kind)
    assert np.all(np.abs(again.parameters[:, BURN]) <= 4.0 * prior.burn_sigma)
    assert np.all(np.abs(again.parameters[:, BURN]).max() > 3.9 * prior.burn_sigma)


def test_a_lean_in_every_heading_ends_where_its_circle_does():
    straight = evolve(fit.blank(1, 1), kind=np.array([2]), spread=np.diag([1.0] * 3 + [1.0, 0.1] + [1.0] * 5)[None])
    split = windowed(straight, PRIORS, np.zeros(1, dtype=np.bool_))
    # All that is likely lies at one end of the line.
    there = evolve(split, evidence=-np.abs(split.window[:, 2] - split.window[:, 2].max()) / 0.1)
    assert not laid(there, PRIORS)[1].any()


def test_a_ridge_is_not_taken_for_straight_where_it_is_narrow_for_its_arc():
    # The circle of leans leaves its tangent by 7 mrad one standard deviation off.
    wide, narrow = (straightened(ridge(0.7, across_rad))[0] for across_rad in (0.05, 0.005))
    assert wide.window[:, 3].tolist() == [0.0]
    assert len(narrow) == len(ridge(0.7, 0.005))


@pytest.mark.slow
def test_what_one_sensor_alone_sees_is_fitted_where_a_further_step_stays():
    truth, tick_s = flights("IRBM", 8, 3), 60
    kind = np.array([TARGET_TYPES.index("IRBM")])
    hidden_s = hidden(truth, 3)
    track, rays = lines_of_sight(truth, 10e-6, 3, sensors=1, period_s=0.1, chance=0.9, hidden_s=hidden_s)
    fitting = Fitting(PRIORS.take(kind), watch_of(1, 0.1, 0.9), True)
    bank = bank_after(fitting, track, rays, tick_s)
    older = bank.seen.track[(bank.ticks > 25) & (bank.seen.last_s[:, 0] > tick_s - 1.0)]
    likely = bank.hypotheses.take(np.isin(bank.hypotheses.track, older) & (probability(bank.hypotheses) > 0.05))
    again = fitting._relinearised(likely, bank.rows, bank.seen, float(tick_s), 1)
    away = (again.parameters - likely.parameters)[:, :, None]
    square = np.sum(away * np.linalg.solve(likely.spread, away), axis=(1, 2))
    assert len(older) > 4
    # A tenth of a standard deviation; two thirds of one is what a tick moves them by.
    assert np.max(square) < 0.01


@pytest.mark.parametrize(("is_alone", "sooner_s"), [(True, {0.0, 12.0, 26.0}), (False, {0.0})])
def test_trials_laid_anew_start_sooner_too_where_one_sensor_alone_sees(is_alone, sooner_s):
    whole = ridge(0.9, 0.05)
    trial = anew(whole, PRIORS, np.full(len(whole), is_alone))
    # In every heading: windows to both sides of their line, over the whole length that the class's lean has.
    for start_s in sooner_s:
        mine = trial.parameters[trial.parameters[:, START] == -start_s]
        azimuth = np.sort(np.arctan2(mine[:, TURN_EAST], mine[:, TURN_NORTH]))
        assert np.diff(azimuth, append=azimuth[0] + 2.0 * np.pi).max() < np.radians(60.0)
    assert set(-trial.parameters[:, START]) == sooner_s
