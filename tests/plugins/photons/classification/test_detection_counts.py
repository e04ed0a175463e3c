"""Detection counts of synthetic looks against a Monte Carlo of Bernoulli looks."""

import numpy as np
import pytest
from numpy.typing import NDArray
from opir_photons.classification import type_densities
from opir_photons.classification.synthetic_looks import MOMENTS
from scipy.stats import norm

Array = NDArray[np.float64]

#: P_d during a burn: constant, rising, certain, and nothing until half of it.
CHANCES = {
    "constant": np.full(MOMENTS, 0.4),
    "rising": np.linspace(0.05, 0.95, MOMENTS),
    "certain": np.ones(MOMENTS),
    "late": np.repeat([0.0, 0.8], MOMENTS // 2),
}

#: Confidence of all comparisons of one test together, and the standard normal quantile of one of
#: them.
CONFIDENCE = 0.999
QUANTILE = float(norm.isf(0.5 * (1.0 - CONFIDENCE) / (2 * MOMENTS)))

BURNS = 20_000


def counts_so_far(chance: Array, looks: int) -> list[Array]:
    """Return the counts (n,) at a detection in each step of a burn, from one look at random in the
    step per burn.
    """
    rng = np.random.default_rng([7, looks])
    hits = rng.random((BURNS, MOMENTS * looks)) < np.repeat(chance, looks)
    counts = np.cumsum(hits, axis=1)
    burns = np.arange(BURNS)
    so_far = list[Array]()
    for step in range(MOMENTS):
        look = step * looks + rng.integers(looks, size=BURNS)
        so_far.append(counts[burns, look][hits[burns, look]].astype(np.float64))
    return so_far


@pytest.mark.slow
@pytest.mark.parametrize("looks", [1, 4])
@pytest.mark.parametrize("name", CHANCES)
def test_counts_have_the_mean_and_variance_of_bernoulli_looks(name: str, looks: int) -> None:
    chance = CHANCES[name]
    period_s = 2.5
    launches = np.stack([np.zeros(MOMENTS), chance])
    step_s = np.full(launches.size, looks * period_s)
    mean, variance = (
        column.reshape(2, -1)[1]
        for column in type_densities._counts(launches.ravel(), step_s, period_s)
    )
    for step, counts in enumerate(counts_so_far(chance, looks)):
        if chance[step] == 0.0:
            continue
        sampled = counts.var()
        moment = np.mean((counts - counts.mean()) ** 4)
        assert abs(mean[step] - counts.mean()) <= QUANTILE * np.sqrt(sampled / len(counts)) + 1e-9
        slack = QUANTILE * np.sqrt(max(moment - sampled**2, 0.0) / len(counts)) + 1e-9
        assert -slack <= variance[step] - sampled <= 0.25 + slack


def test_sparse_looks_are_counted_by_burn_length() -> None:
    # A certain detection every 4 steps: the count at a look is one more than the looks before it.
    mean, variance = type_densities._counts(np.ones(MOMENTS), np.full(MOMENTS, 1.0), 4.0)
    steps = np.arange(MOMENTS)
    assert abs(np.mean(mean - (1.0 + steps // 4))) < 1e-12
    # The rounding of the time in periods has a variance of 1/12, the place in a step one of 1/16 of
    # that.
    assert np.allclose(variance, (1.0 + 1.0 / 16.0) / 12.0, rtol=1e-12)


def test_counts_of_sources_are_1() -> None:
    mean, variance = type_densities._counts(np.array([0.0, 0.3, 1.0]), np.zeros(3), 2.5)
    assert mean.tolist() == variance.tolist() == [1.0, 1.0, 1.0]
