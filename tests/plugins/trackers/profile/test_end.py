"""The end of a burn, of `boost-profile`: against distributions in closed form, and of fits that have run away."""

import numpy as np
import pytest
from opir_trackers.profile.end import DEVIATES, Silence, ends_of


def silence(last, until, chance=0.5, period=0.1):
    return Silence(*(np.atleast_1d(value)[:, None] for value in (last, until, chance)), np.array([period]))


def test_an_end_that_may_be_any_time_after_the_last_light_is_a_truncated_lognormal():
    from scipy.integrate import quad
    from scipy.stats import norm, truncnorm

    start, mean, sigma, last = 4.0, np.log(96.0), 0.08, 104.0
    found = ends_of(np.array([start]), np.array([mean]), np.array([sigma**2]), silence(last, last))
    law = truncnorm((np.log(last - start) - mean) / sigma, np.inf, loc=mean, scale=sigma)
    assert found.mean == pytest.approx(law.mean(), abs=2e-4)
    assert found.variance == pytest.approx(law.var(), rel=0.01)
    assert np.exp(found.evidence) == pytest.approx(norm.sf(np.log(last - start), mean, sigma), rel=0.01)
    quantiles = found.mean + np.sqrt(found.variance) * found.quantiles[0]
    # A cell of the quadrature is a few hundredths of the way on: as much of the distance to the last light.
    passed = np.exp(quantiles) - (last - start)
    assert passed == pytest.approx(np.exp(law.ppf(norm.cdf(DEVIATES))) - (last - start), rel=0.05)
    # Three nodes are exact for polynomials of the fifth degree.
    there = found.mean + np.sqrt(found.variance) * found.nodes[0]
    for power in range(6):
        exact = quad(lambda x, n=power: (x - mean) ** n * law.pdf(x), law.ppf(0.0), law.ppf(1.0 - 1e-12))[0]
        assert np.sum(found.weights[0] * (there - mean) ** power) == pytest.approx(exact, rel=0.02)


def test_silence_ends_a_burn_within_a_geometric_number_of_looks():
    last, until = np.full((1, 2), 104.0), np.full((1, 2), 110.0)
    both = Silence(last, until, np.full((1, 2), 0.5), np.full(2, 0.1))
    start, sigma = np.zeros(1), np.array([0.04])
    found = ends_of(start, np.log([104.0]), sigma, both)
    missed = np.arange(60)
    weight = 0.25**missed
    expected = np.sum(weight * (missed + 0.5) * 0.1) / weight.sum()
    assert np.exp(found.mean) - 104.0 == pytest.approx(expected, rel=0.02)
    far = ends_of(start, np.log([300.0]), sigma, both)
    assert far.evidence < found.evidence - 10.0


@pytest.mark.parametrize("period", [0.05, 0.2])
def test_a_look_at_the_tick_is_not_missed_before_it_comes(period):
    # The looks at 104.0 and 105.0, and those between: of the last, at the tick, nothing is known at the tick.
    start, mean, sigma = np.zeros(1), np.log([104.0]), np.array([0.04])
    seen = ends_of(start, mean, sigma, silence(105.0 - period, 105.0, 0.95, period))
    fresh = ends_of(start, mean, sigma, silence(105.0 - period, 105.0 - period, 0.95, period))
    assert seen.evidence == pytest.approx(fresh.evidence, abs=1e-9)
    assert seen.mean == pytest.approx(fresh.mean, abs=1e-9)


@pytest.mark.parametrize("period", [0.05, 0.1])
def test_many_missed_looks_leave_an_end_between_the_last_light_and_the_next_look(period):
    both = Silence(np.full((1, 2), 104.0), np.full((1, 2), 110.0), np.full((1, 2), 0.98), np.full(2, period))
    found = ends_of(np.zeros(1), np.log([104.0]), np.array([0.04]), both)
    # Even over the period; the edge of that is known to half a cell of the quadrature, a twelfth of the period.
    assert np.exp(found.mean) - 104.0 == pytest.approx(0.5 * period, rel=0.05)
    assert np.sqrt(found.variance) * 104.0 == pytest.approx(period / np.sqrt(12.0), rel=0.05)


def test_a_sensor_that_fails_does_not_end_a_burn_that_another_sees():
    both = Silence(np.array([[50.0, 90.0]]), np.array([[90.0, 90.0]]), np.full((1, 2), 0.8), np.full(2, 0.1))
    found = ends_of(np.zeros(1), np.log([120.0]), np.array([0.0069]), both)
    assert np.exp(found.mean) == pytest.approx(120.0, abs=0.5)


@pytest.mark.parametrize(("chance", "period", "last"), [(0.6, 0.2, 130.0), (0.72, 0.1, 180.0), (0.95, 0.05, 206.0)])
def test_silence_of_the_only_sensor_ends_a_burn_as_sharply_as_its_looks_are_dense(chance, period, last):
    seen = silence(last, last + 8.0, chance, period)
    found = ends_of(np.zeros(1), np.log([206.0]), np.array([0.04]), seen)
    # A whole number of missed looks, geometric, and a place between two looks, even; the fit adds next to nothing.
    sigma_s = period * np.sqrt((1.0 - chance) / chance**2 + 1.0 / 12.0)
    assert np.sqrt(found.variance[0]) * last == pytest.approx(sigma_s, rel=0.05)


def test_a_burn_that_is_far_too_short_goes_on_unseen_by_a_sensor_that_failed():
    found = ends_of(np.zeros(1), np.log([206.0]), np.array([0.0025]), silence(100.0, 108.0, 0.8, 0.1))
    assert np.exp(found.mean) == pytest.approx(206.0, rel=0.01)


@pytest.mark.filterwarnings("error")
@pytest.mark.parametrize(("mean", "sigma"), [(-25.0, 377.0), (900.0, 0.2), (-900.0, 0.2), (4.6, 1e150), (4.6, np.nan)])
def test_of_the_end_of_a_fit_that_has_run_away_nothing_is_told_and_others_are_told_theirs(mean, sigma):
    alone = ends_of(np.zeros(1), np.log([104.0]), np.array([0.04]), silence(100.0, 101.0))
    both = silence([100.0, 100.0], [101.0, 101.0], [0.5, 0.5])
    found = ends_of(np.zeros(2), np.array([mean, np.log(104.0)]), np.array([sigma**2, 0.04]), both)
    assert found.mean[0] == mean
    assert found.nodes[0] == pytest.approx([-2.856970, -1.355626, 0.0, 1.355626, 2.856970], abs=1e-6)
    for whole, own in zip(found, alone, strict=True):
        assert whole[1] == pytest.approx(own[0], rel=1e-12)
