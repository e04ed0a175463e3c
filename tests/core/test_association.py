"""Assignments and association probabilities on sparse graphs, held to trying everything."""

from itertools import product

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from opir_core.tracking.assignment import components, nearest
from opir_core.tracking.joint_association import cluster_marginals, marginals, propagated_marginals

sizes = st.integers(1, 6)


def graph(seed: int, height: int, width: int, density: float) -> np.ndarray:
    """Return likelihood ratios over several orders of magnitude, 0 where there is no pair."""
    rng = np.random.default_rng(seed)
    return np.exp(3.0 * rng.normal(size=(height, width))) * (rng.random((height, width)) < density)


def tried(weight: np.ndarray) -> np.ndarray:
    """Return marginals by adding up every one-to-one explanation."""
    height, width = weight.shape
    beta, total = np.zeros_like(weight), 0.0
    for explanation in product(range(width + 1), repeat=height):
        used = [column for column in explanation if column < width]
        if len(set(used)) < len(used):
            continue
        chance = float(np.prod([weight[row, c] for row, c in enumerate(explanation) if c < width]))
        total += chance
        for row, column in enumerate(explanation):
            if column < width:
                beta[row, column] += chance
    return beta / total


@settings(max_examples=60, deadline=None)
@given(seed=st.integers(0, 2**31), height=sizes, width=st.integers(1, 5), density=st.floats(0.2, 1.0))
def test_marginals_are_those_of_trying_everything(seed: int, height: int, width: int, density: float) -> None:
    weight = graph(seed, height, width, density)
    row, column = np.nonzero(weight)
    expected = tried(weight)
    assert np.allclose(marginals(row, column, weight[row, column]), expected[row, column], rtol=1e-10, atol=1e-13)
    assert np.allclose(cluster_marginals(weight), expected, rtol=1e-10, atol=1e-13)


@settings(max_examples=200, deadline=None)
@given(seed=st.integers(0, 2**31), height=st.integers(1, 9), width=st.integers(1, 9), density=st.floats(0.1, 1.0))
def test_nearest_is_the_cheapest_assignment(seed: int, height: int, width: int, density: float) -> None:
    from scipy.optimize import linear_sum_assignment

    rng = np.random.default_rng(seed)
    cost = rng.normal(size=(height, width))
    row, column = np.nonzero(rng.random((height, width)) < density)
    chosen = nearest(row, column, cost[row, column])
    dense = np.zeros((height, width))
    dense[row, column] = np.minimum(cost[row, column], 0.0)
    assert cost[row, column][chosen].sum() == pytest.approx(dense[linear_sum_assignment(dense)].sum(), abs=1e-12)
    assert len(set(row[chosen])) == len(set(column[chosen])) == chosen.sum()


def test_components_are_numbered_by_their_first_pair() -> None:
    group, count = components(np.array([5, 9, 5, 7]), np.array([1, 2, 3, 3]))
    assert count == 2
    assert group.tolist() == [0, 1, 0, 0]


def test_no_pairs_are_no_trouble() -> None:
    none = np.empty(0, dtype=np.int64)
    assert len(nearest(none, none, np.empty(0))) == 0
    assert len(marginals(none, none, np.empty(0))) == 0


def test_a_wide_cluster_is_propagated_and_stays_lawful() -> None:
    weight = np.exp(np.random.default_rng(3).normal(size=(16, 16)))
    beta = cluster_marginals(weight, exact_width=8)
    assert np.array_equal(np.sort(beta.ravel()), np.sort(propagated_marginals(weight).ravel()))
    assert beta.min() > 0.0
    assert beta.sum(axis=0).max() < 1.0
    assert beta.sum(axis=1).max() < 1.0
    exact = cluster_marginals(weight[:6, :6])
    assert np.abs(propagated_marginals(weight[:6, :6]) - exact).max() < 0.05
