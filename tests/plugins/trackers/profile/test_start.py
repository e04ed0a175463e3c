"""When a boost started, of `boost-profile`: against integrals, and what a fit makes of the first light."""

from itertools import pairwise

import numpy as np
import pytest
from attrs import evolve
from class_flights import PRIORS, bank_after, flights, hidden, lines_of_sight, watch_of
from opir_trackers.profile import fit, flight
from opir_trackers.profile.bank import Fitting
from opir_trackers.profile.family import START, TURN_EAST, TURN_NORTH
from opir_trackers.profile.fit import with_priors
from opir_trackers.profile.hypotheses import probability
from opir_trackers.profile.report import Basis, report
from opir_trackers.profile.start import starts_of
from scipy.integrate import quad
from scipy.stats import halfnorm, norm

from opir_core.scene.scene import TARGET_TYPES
from opir_core.scoring.consistency import nees


@pytest.mark.parametrize(
    ("mean", "sigma", "first", "hidden_s"),
    [
        (-3.0, 2.0, 1.0, 15.0),
        (0.9, 0.1, 1.0, 15.0),
        (1.3, 0.1, 1.0, 15.0),
        (2.5, 1.0, 1.0, 3.0),
        (-20.0, 1.0, 1.5, 15.0),
        (0.0, 14.99, 1.0, 15.0),
        (3.0, 0.2, 0.2, 15.0),
    ],
)
def test_a_start_is_before_the_first_light_by_a_half_normal_time(mean, sigma, first, hidden_s):
    found = starts_of(*(np.array([value]) for value in (mean, sigma**2, first, hidden_s)))

    def height(s):
        prior = norm.pdf(s, 0.0, hidden_s)
        return norm.pdf(s, mean, sigma) / prior * (0.99 * halfnorm.pdf(first - s, scale=hidden_s) + 0.01 * prior)

    edges = np.unique([*np.linspace(mean - 12.0 * sigma, mean + 12.0 * sigma, 25), first])
    spans = list(pairwise(edges))
    whole, once, twice = (sum(quad(lambda s, n=n: s**n * height(s), *span)[0] for span in spans) for n in range(3))
    assert found.evidence[0] == pytest.approx(np.log(whole), abs=1e-4)
    assert found.mean[0] == pytest.approx(once / whole, abs=1e-3 * sigma)
    assert found.variance[0] == pytest.approx(twice / whole - (once / whole) ** 2, rel=1e-3)


def launches(kind, runs, seed, ticks, hidden_s):
    """Return the times of the first light of flights that one sensor sees, and what is told of them after ticks."""
    truth = flights(kind, runs, seed)
    track, rays = lines_of_sight(truth, 5e-5, seed, sensors=1, period_s=0.2, chance=0.5, hidden_s=hidden_s)
    priors = PRIORS.take([TARGET_TYPES.index(kind)])
    fitting = Fitting(priors, watch_of(1, 0.2, 0.5), True)
    bank = bank_after(fitting, track, rays, ticks)
    told = report(bank.hypotheses, probability(bank.hypotheses), float(ticks), Basis(priors, "kepler"))
    return np.min(bank.seen.first_s, axis=1), told


def test_no_start_is_told_after_the_first_light():
    first_s, told = launches("IRBM", 20, 3, 20, 0.0)
    assert (told.launch[:, 2] < first_s).all()


@pytest.mark.slow
def test_starts_of_flights_that_clouds_hid_as_the_prior_has_it_are_told_as_surely_as_they_are_known():
    truth = flights("IRBM", 30, 8)
    _, told = launches("IRBM", 30, 8, 40, hidden(truth, 8))
    assert len(told) > 25
    away = told.launch[:, 2] - fit.family_of(truth, PRIORS).start_s[told.track]
    values = np.square(away) / told.launch_covariance[:, 2, 2]
    assert abs(values.mean() - 1.0) < 3.3 * np.sqrt(2.0 / len(values))


def test_a_lean_beyond_its_class_tells_headings_apart_as_the_ring_about_it_bends():
    number = TARGET_TYPES.index("ICBM")
    prior = PRIORS.take([number])
    turn, sigma = float(prior.turn_rad[0]), float(prior.turn_sigma_rad[0])
    for share in (0.9, 1.1, 1.3):
        there = evolve(fit.blank(1, 1), kind=np.array([number]), is_bent=np.ones(1, dtype=np.int64))
        x = there.parameters.copy()
        lean = fit.natural(x, prior).lean
        x[:, TURN_NORTH] = share * turn * lean
        normal, right, _, _ = with_priors(evolve(there, parameters=x), prior, np.zeros((1, 10, 10)), np.zeros((1, 10)))
        step = 1e-4

        def square(aside, share=share):
            return 0.5 * (np.hypot(share * turn, aside) - turn) ** 2 / sigma**2

        bend = (square(step) - 2.0 * square(0.0) + square(-step)) / step**2
        expected = (1.0 / 4.0 + max(bend, 0.0)) / lean[0] ** 2
        assert normal[0, TURN_EAST, TURN_EAST] == pytest.approx(expected, rel=1e-4)
        assert right[0, TURN_EAST] == pytest.approx(0.0, abs=1e-9)
        assert normal[0, START, START] == pytest.approx(1.0 / prior.hidden_s[0] ** 2)


def test_a_boost_that_clouds_hid_for_long_does_not_run_away_from_the_one_sensor_that_sees_it():
    """Seen first half a minute after the start, at 500 m/s: from a start that is told late no slope leads back."""
    number, runs = TARGET_TYPES.index("ICBM"), 8
    truth = evolve(flights("ICBM", 500, 1).take(np.full(runs, 48)), track=np.arange(runs))
    track, rays = lines_of_sight(truth, 5e-5, 3, sensors=1, period_s=0.2, chance=0.6, hidden_s=np.full(runs, 35.5))
    priors = PRIORS.take([number])
    fitting = Fitting(priors, watch_of(1, 0.2, 0.6), True)
    bank = bank_after(fitting, track, rays, 65)
    told = report(bank.hypotheses, probability(bank.hypotheses), 65.0, Basis(priors, "kepler"))
    known, unsure = fit.family_of(truth, PRIORS), np.zeros((runs, 10, 10))
    exact = flight.states(known, unsure, 65.0, *flight.burnouts(known, unsure), "kepler").mean
    # So long a time is improbable, and so are its errors, but not as much as those of what runs away: 2000 and more.
    assert nees(told.state - exact, told.state_covariance).max() < 100.0


def test_steps_that_are_cut_short_fit_by_as_much_less_as_the_parabola_has_it():
    dice = np.random.default_rng(5)
    root = dice.normal(size=(3, 10, 10))
    spread = root @ root.transpose(0, 2, 1) * np.outer(np.logspace(-3, 4, 10), np.logspace(-3, 4, 10))
    there = dice.normal(size=(3, 10)) * np.logspace(-3, 4, 10)
    here = np.array([0.5, 1.0, 0.2])[:, None] * there
    found = fit.shortfall(fit.Solved(there, spread, np.zeros(3), np.array([1.0, 1.0, 4.0])), here)
    away = there - here
    squares = np.array([each @ np.linalg.solve(matrix, each) for each, matrix in zip(away, spread, strict=True)])
    assert found == pytest.approx(0.5 * squares * [1.0, 1.0, 4.0], rel=1e-6)
    assert found[1] == 0.0


@pytest.mark.filterwarnings("error")
def test_of_fits_that_have_run_away_no_shortfall_is_told():
    spread = np.stack([np.eye(10), -np.eye(10), np.full((10, 10), np.nan)])
    found = fit.shortfall(fit.Solved(np.ones((3, 10)), spread, np.zeros(3), np.ones(3)), np.zeros((3, 10)))
    assert found[0] == pytest.approx(5.0)
    assert found[1:] == pytest.approx(0.0)
