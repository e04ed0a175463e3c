"""Parts by the start that stand for what one sensor sees of a boost: against integrals and exact posteriors."""

from itertools import pairwise

import numpy as np
import pytest
from attrs import evolve
from class_flights import PRIORS, bank_after, flights, lines_of_sight, watch_of
from exact_boost_posteriors import Looks, effective, sampled, states_of
from opir_trackers.profile import fit
from opir_trackers.profile.bank import Fitting
from opir_trackers.profile.family import SHAPE, START
from opir_trackers.profile.fit import Solved
from opir_trackers.profile.hypotheses import probability
from opir_trackers.profile.parts import parted, parts_of
from opir_trackers.profile.report import Basis, report
from scipy.integrate import quad
from scipy.stats import halfnorm, norm

from opir_core.scene.scene import TARGET_TYPES


def linear(mean, sigma, count=1):
    """Return hypotheses of a linear problem with this start, its solutions, and the priors of each."""
    dice = np.random.default_rng(4)
    root = dice.normal(size=(10, 10))
    spread = root @ root.T
    scale = np.ones(10)
    scale[START] = sigma / np.sqrt(spread[START, START])
    spread = np.tile(spread * scale[:, None] * scale, (count, 1, 1))
    parameters = np.tile(dice.normal(size=10), (count, 1))
    parameters[:, START] = mean
    solution = Solved(parameters, spread, np.full(count, -3.0), np.ones(count))
    return (
        evolve(fit.blank(count, 1), parameters=parameters, spread=spread),
        solution,
        PRIORS.take(np.zeros(count, int)),
    )


@pytest.mark.parametrize(("mean", "sigma"), [(-3.0, 2.0), (0.5, 2.0), (-20.0, 4.0), (-8.0, 9.0)])
def test_parts_of_a_linear_problem_have_its_moments_before_the_first_light(mean, sigma):
    first = 1.0
    hypotheses, solution, priors = linear(mean, sigma)
    parts = parts_of(hypotheses, solution, np.array([first]), priors)
    given = parts.given(Solved(*(each[parts.origin] for each in solution)))

    def height(s):
        prior = norm.pdf(s, 0.0, priors.hidden_s[0])
        return norm.pdf(s, mean, sigma) / prior * 0.99 * halfnorm.pdf(first - s, scale=priors.hidden_s[0])

    spans = list(pairwise(np.linspace(mean - 12.0 * sigma, first, 40)))
    whole, once, twice = (sum(quad(lambda s, n=n: s**n * height(s), *span)[0] for span in spans) for n in range(3))
    expected, variance = once / whole, twice / whole - (once / whole) ** 2
    share = np.exp(given.evidence - solution.evidence[0])
    # Beside the starts before it, the evidence has those of which the first light tells nothing.
    assert share.sum() == pytest.approx(whole + 0.01, rel=1e-3)
    share /= share.sum()
    middle = share @ given.parameters
    away = given.parameters - middle
    spread = np.einsum("n,nij->ij", share, given.spread + away[:, :, None] * away[:, None])
    gain = solution.spread[0, START] / sigma**2
    assert middle == pytest.approx(solution.parameters[0] + gain * (expected - mean), abs=3e-3 * sigma)
    exact = solution.spread[0] + (variance - sigma**2) * gain[:, None] * gain
    assert spread == pytest.approx(exact, abs=5e-3 * np.abs(exact).max())


def test_where_the_first_light_may_be_anothers_the_whole_stays():
    hypotheses, solution, priors = linear(30.0, 4.0)
    assert not len(parts_of(hypotheses, solution, np.array([1.0]), priors).origin)


def test_parts_far_from_the_whole_have_courses_all_the_same():
    hypotheses, solution, priors = linear(-20.0, 4.0)
    spread = hypotheses.spread.copy()
    spread[:, SHAPE, START] = spread[:, START, SHAPE] = 200.0 * spread[:, START, START]
    parts = parts_of(evolve(hypotheses, spread=spread), solution, np.array([1.0]), priors)
    assert np.isfinite(fit.family_of(parts.hypotheses, PRIORS).burnout_s).all()


def test_parts_that_went_astray_or_of_which_one_holds_nearly_all_leave_the_whole():
    whole = evolve(fit.blank(4, 1), track=np.arange(4))
    parts = whole.take(np.repeat([0, 1, 3], 3))
    parameters = parts.parameters.copy()
    parameters[4] = np.nan
    evidence = np.log([0.2, 0.6, 0.2, 0.2, 0.6, 0.2, 0.02, 0.96, 0.02])
    parts = evolve(parts, parameters=parameters, evidence=evidence)
    told = parted(whole, parts, np.repeat([0, 1, 3], 3))
    assert told.track.tolist() == [0, 0, 0, 1, 2, 3]
    assert np.exp(told.evidence[:3]) == pytest.approx([0.2, 0.6, 0.2])


def followed(kind, runs, seed, ticks, sensors=1):
    """Return the fitting of flights that clouds hid for six seconds, and the bank after so many ticks."""
    truth = flights(kind, runs, seed)
    seeing = {"sensors": sensors, "period_s": 0.1, "chance": 0.7}
    track, rays = lines_of_sight(truth, 2e-5, seed, **seeing, hidden_s=6.0)
    priors = PRIORS.take([TARGET_TYPES.index(kind)])
    fitting = Fitting(priors, watch_of(sensors, 0.1, 0.7), True)
    bank = bank_after(fitting, track, rays, ticks)
    return fitting, bank


def expected_square(told, row, states, weight):
    """Return the mean over a posterior of the normalised square of what a track tells, over its six degrees."""
    away = np.linalg.solve(np.linalg.cholesky(told.state_covariance[row]), (states - told.state[row]).T)
    return weight @ np.square(away).sum(axis=0) / 6.0


def both(fitting, bank, tick_s):
    """Return what is told of a bank without parts, and with them."""
    likely, finer = bank.hypotheses, fitting.parts(bank, tick_s)
    rest = tick_s, Basis(fitting.priors, "kepler")
    whole = report(likely, probability(likely), *rest)
    return whole, report(likely, probability(likely), *rest, (finer, probability(finer)))


@pytest.mark.slow
def test_states_are_told_as_surely_as_exact_posteriors_have_them():
    kind, tick_s = TARGET_TYPES.index("IRBM"), 28.0
    fitting, bank = followed("IRBM", 12, 14, int(tick_s))
    whole, apart = both(fitting, bank, tick_s)
    found = []
    for row, number in enumerate(whole.track.tolist()):
        mine, rows = (each.take(each.track == number) for each in (bank.hypotheses, bank.rows))
        mine, seen = evolve(mine, kind=np.full(len(mine), kind)), bank.seen.of(np.array([number]))
        looks = Looks.of(seen, tick_s, 0.1, 0.7)
        boosts, weight = sampled(mine, rows, looks, 5000, number, ends=False)
        assert effective(weight) > 100.0
        states = states_of(boosts, tick_s)
        found.append([expected_square(told, row, states, weight) for told in (whole, apart)])
    of_whole, of_parts = np.mean(found, axis=0)
    # The samples of a dozen flights leave a mean uncertain by 0.03.
    assert abs(of_parts - 1.0) < 0.06
    assert of_whole > 1.06


def test_parts_tell_states_and_launches_and_wholes_the_rest():
    fitting, bank = followed("IRBM", 6, 14, 28)
    whole, apart = both(fitting, bank, 28.0)
    assert np.array_equal(whole.track, apart.track)
    for name in ("impact", "impact_covariance", "impact_sigmas", "burnout", "type_probability"):
        assert np.array_equal(getattr(whole, name), getattr(apart, name), equal_nan=True)
    for name in ("state", "state_covariance", "launch", "launch_covariance"):
        assert np.all(np.any(getattr(whole, name) != getattr(apart, name), axis=-1))
    assert np.linalg.eigvalsh(apart.state_covariance).min() > 0.0
    assert np.linalg.eigvalsh(apart.launch_covariance).min() > 0.0


def test_what_two_sensors_have_seen_and_starts_that_are_known_have_no_parts():
    fitting, bank = followed("IRBM", 6, 14, 28, sensors=2)
    assert fitting.parts(bank, 28.0) is None
    fitting, bank = followed("IRBM", 6, 14, 28)
    assert len(fitting.parts(bank, 28.0)) > len(bank.hypotheses)
    spread = bank.hypotheses.spread.copy()
    spread[:, START] *= 0.1
    spread[:, :, START] *= 0.1
    known = evolve(bank, hypotheses=evolve(bank.hypotheses, spread=spread))
    assert fitting.parts(known, 28.0) is None
