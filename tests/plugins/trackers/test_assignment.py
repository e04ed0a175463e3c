"""Assignments and association probabilities on sparse graphs, held to trying everything."""

from itertools import product

import numpy as np
import pytest
from hypothesis import given, strategies as st
from opir_trackers.assignment import (
    belief_propagation,
    cheapest_assignment,
    components,
    exact_marginals,
    marginals,
    ranks,
)

from examples import examples

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


@examples(60)
@given(seed=st.integers(0, 2**31), height=sizes, width=st.integers(1, 5), density=st.floats(0.2, 1.0))
def test_marginals_are_those_of_trying_everything(seed: int, height: int, width: int, density: float) -> None:
    weight = graph(seed, height, width, density)
    row, column = np.nonzero(weight)
    expected = tried(weight)
    assert np.allclose(marginals(row, column, weight[row, column]), expected[row, column], rtol=1e-10, atol=1e-13)
    assert np.allclose(exact_marginals(weight[None])[0], expected, rtol=1e-10, atol=1e-13)
    turned = exact_marginals(np.stack([weight.T, 2.0 * weight.T]))[0].T
    assert np.allclose(turned, expected, rtol=1e-10, atol=1e-13)


@examples(200)
@given(seed=st.integers(0, 2**31), height=st.integers(1, 9), width=st.integers(1, 9), density=st.floats(0.1, 1.0))
def test_nearest_is_the_cheapest_assignment(seed: int, height: int, width: int, density: float) -> None:
    from scipy.optimize import linear_sum_assignment

    rng = np.random.default_rng(seed)
    cost = rng.normal(size=(height, width))
    row, column = np.nonzero(rng.random((height, width)) < density)
    chosen = cheapest_assignment(row, column, cost[row, column])
    dense = np.zeros((height, width))
    dense[row, column] = np.minimum(cost[row, column], 0.0)
    assert cost[row, column][chosen].sum() == pytest.approx(dense[linear_sum_assignment(dense)].sum(), abs=1e-12)
    assert len(set(row[chosen])) == len(set(column[chosen])) == chosen.sum()


def test_components_are_numbered_by_their_first_pair() -> None:
    group, count = components(np.array([5, 9, 5, 7]), np.array([1, 2, 3, 3]))
    assert count == 2
    assert group.tolist() == [0, 1, 0, 0]


@given(values=st.lists(st.integers(0, 40) | st.integers(0, 2**62), max_size=30))
def test_ranks_are_places_among_the_different_numbers(values: list[int]) -> None:
    different = sorted(set(values))
    assert ranks(np.array(values, dtype=np.int64)).tolist() == [different.index(value) for value in values]


def test_no_pairs_are_no_trouble() -> None:
    none = np.empty(0, dtype=np.int64)
    assert len(cheapest_assignment(none, none, np.empty(0))) == 0
    assert len(marginals(none, none, np.empty(0))) == 0


def test_a_wide_cluster_is_propagated_and_stays_lawful() -> None:
    weight = np.exp(np.random.default_rng(3).normal(size=(16, 16)))
    row, column = np.nonzero(weight)
    beta = marginals(row, column, weight[row, column])
    assert np.array_equal(beta, belief_propagation(row, column, weight[row, column]))
    assert beta.min() > 0.0
    assert np.bincount(row, beta).max() < 1.0
    assert np.bincount(column, beta).max() < 1.0
    small, (row, column) = weight[:6, :6], np.nonzero(weight[:6, :6])
    assert (
        np.abs(belief_propagation(row, column, small[row, column]) - exact_marginals(small[None])[0].ravel()).max()
        < 0.05
    )


def test_belief_propagation_is_exact_without_loops() -> None:
    """A chain of ten, and a star, with likelihood ratios from 1e-8 to 1e12."""
    rng = np.random.default_rng(5)
    row = np.concatenate([np.repeat(np.arange(10), 2)[1:], np.full(6, 20)])
    column = np.concatenate([np.repeat(np.arange(10), 2)[:-1], np.arange(20, 26)])
    ratio = 10.0 ** rng.uniform(-8.0, 12.0, len(row))
    weight = np.zeros((21, 26))
    weight[row, column] = ratio
    used = exact_marginals(weight[None, :10, :10])[0][row[:19], column[:19]]
    assert np.allclose(belief_propagation(row, column, ratio)[:19], used, rtol=1e-9, atol=1e-12)
    assert np.allclose(belief_propagation(row, column, ratio)[19:], ratio[19:] / (1.0 + ratio[19:].sum()), rtol=1e-9)


def test_overwhelming_evidence_is_no_trouble() -> None:
    """Products of these likelihood ratios are far beyond the largest float."""
    weight = np.full((5, 5), 1e-3)
    weight[np.arange(5), np.arange(5)] = 1e120
    assert np.allclose(exact_marginals(weight[None])[0], np.eye(5), atol=1e-12)


def test_wide_clusters_that_fall_apart_are_summed_exactly() -> None:
    """Ten tracks in a row, each with a ray of its own beyond doubt and faint links to the next one's."""
    count = 10
    row = np.concatenate([np.arange(count), np.arange(count)])
    column = np.concatenate([np.arange(count), (np.arange(count) + 1) % count])
    ratio = np.concatenate([np.full(count, 1e3), np.full(count, 1e-2)])
    weight = np.zeros((count, count))
    weight[row, column] = ratio
    exact = exact_marginals(weight[None])[0][row, column]
    assert np.allclose(marginals(row, column, ratio), exact, atol=1e-4)
