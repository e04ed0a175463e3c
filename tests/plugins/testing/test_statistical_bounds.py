"""The intervals and distances of contracts, against SciPy's distributions, and their stated error
by Monte Carlo.
"""

import numpy as np
import pytest
from opir_testing.contracts.contract import Z_999, count_excess, rate_excess, uniformity_excess
from scipy import stats


def test_the_half_width_is_that_of_999_permille() -> None:
    assert pytest.approx(stats.norm.isf(0.0005), rel=1e-12) == Z_999


def test_counts_of_chances_stay_inside_as_often_as_stated() -> None:
    chances = np.random.default_rng(1).uniform(0.05, 0.95, 400)
    draws = (np.random.default_rng(2).random((20_000, 400)) < chances).sum(axis=1)
    outside = sum(count_excess(float(count), chances) > 1.0 for count in draws)
    assert outside <= stats.binom.isf(0.001, 20_000, 0.001)


def test_counts_at_rates_stay_inside_about_as_often_as_stated() -> None:
    draws = np.random.default_rng(3).poisson(60.0, 20_000)
    outside = sum(rate_excess(float(count), 60.0) > 1.0 for count in draws)
    # The normal's half width is a little narrow for a Poisson tail; three in a thousand is its
    # worst above 50.
    assert outside <= stats.binom.isf(0.001, 20_000, 0.002)


def test_the_distance_of_distributions_is_kolmogorovs() -> None:
    values = np.random.default_rng(4).beta(1.2, 1.0, 500)
    count = len(values)
    distance = stats.kstest(values, "uniform").statistic
    expected = distance * (np.sqrt(count) + 0.12 + 0.11 / np.sqrt(count)) / 1.950
    assert uniformity_excess(values) == pytest.approx(expected, rel=1e-12)
    # At Stephens' point, the probability of what lies beyond it is 0.1 %.
    at_the_point = 1.950 / (np.sqrt(count) + 0.12 + 0.11 / np.sqrt(count))
    assert stats.kstwo.sf(at_the_point, count) == pytest.approx(0.001, rel=0.05)


def test_what_is_off_is_found() -> None:
    assert count_excess(260, np.full(400, 0.5)) > 1.0
    assert rate_excess(100, 60.0) > 1.0
    assert uniformity_excess(np.random.default_rng(5).beta(1.5, 1.0, 500)) > 1.0
    assert count_excess(0, np.zeros(5)) == 0.0
    assert uniformity_excess(np.empty(0)) == 0.0
