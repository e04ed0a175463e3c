"""Assignments and association probabilities on sparse graphs, held to trying everything."""

from itertools import product

import numpy as np
import pytest
from hypothesis import given, strategies as st
from opir_estimation import (
    belief_propagation,
    cheapest_assignment,
    ranks,
)
from opir_estimation.assignment import components

from examples import examples

sizes = st.integers(1, 6)


def graph(seed: int, height: int, width: int, density: float) -> np.ndarray:
    """Return likelihood ratios over several orders of magnitude, 0 where there is no pair."""
    rng = np.random.default_rng(seed)
    return np.exp(3.0 * rng.normal(size=(height, width))) * (rng.random((height, width)) < density)


def tried(weight: np.ndarray) -> np.ndarray:
    """Return marginals by adding up every one-to-one explanation."""
    height, width = weight.shape
    beta = np.zeros_like(weight)
    total = 0.0
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
@given(
    seed=st.integers(0, 2**31), height=sizes, width=st.integers(1, 5), density=st.floats(0.2, 1.0)
)
def test_belief_propagation_is_near_trying_everything(
    seed: int, height: int, width: int, density: float
) -> None:
    weight = np.minimum(graph(seed, height, width, density), 3.0)
    row, column = np.nonzero(weight)
    beta = belief_propagation(row, column, weight[row, column])
    assert np.abs(beta - tried(weight)[row, column]).max(initial=0.0) < 0.15
    assert np.bincount(row, beta, 1).max() <= 1.0
    assert np.bincount(column, beta, 1).max() <= 1.0 + 1e-3


@examples(200)
@given(
    seed=st.integers(0, 2**31),
    height=st.integers(1, 9),
    width=st.integers(1, 9),
    density=st.floats(0.1, 1.0),
)
def test_nearest_is_the_cheapest_assignment(
    seed: int, height: int, width: int, density: float
) -> None:
    from scipy.optimize import linear_sum_assignment

    rng = np.random.default_rng(seed)
    cost = rng.normal(size=(height, width))
    row, column = np.nonzero(rng.random((height, width)) < density)
    chosen = cheapest_assignment(row, column, cost[row, column])
    dense = np.zeros((height, width))
    dense[row, column] = np.minimum(cost[row, column], 0.0)
    assert cost[row, column][chosen].sum() == pytest.approx(
        dense[linear_sum_assignment(dense)].sum(), abs=1e-12
    )
    assert len(set(row[chosen])) == len(set(column[chosen])) == chosen.sum()


def test_components_are_numbered_by_their_first_pair() -> None:
    group, count = components(np.array([5, 9, 5, 7]), np.array([1, 2, 3, 3]))
    assert count == 2
    assert group.tolist() == [0, 1, 0, 0]


@given(values=st.lists(st.integers(0, 40) | st.integers(0, 2**62), max_size=30))
def test_ranks_are_places_among_the_different_numbers(values: list[int]) -> None:
    different = sorted(set(values))
    assert ranks(np.array(values, dtype=np.int64)).tolist() == [
        different.index(value) for value in values
    ]


def test_no_pairs_are_no_trouble() -> None:
    none = np.empty(0, dtype=np.int64)
    assert len(cheapest_assignment(none, none, np.empty(0))) == 0
    assert len(belief_propagation(none, none, np.empty(0))) == 0


def test_many_pairs_are_lawful() -> None:
    weight = np.exp(np.random.default_rng(3).normal(size=(16, 16)))
    row, column = np.nonzero(weight)
    beta = belief_propagation(row, column, weight[row, column])
    assert beta.min() > 0.0
    assert np.bincount(row, beta).max() < 1.0
    assert np.bincount(column, beta).max() < 1.0


def test_belief_propagation_is_exact_without_loops() -> None:
    """A chain of five, and a star, with likelihood ratios from 1e-8 to 1e12."""
    rng = np.random.default_rng(5)
    row = np.concatenate([np.repeat(np.arange(5), 2)[1:], np.full(6, 20)])
    column = np.concatenate([np.repeat(np.arange(5), 2)[:-1], np.arange(20, 26)])
    ratio = 10.0 ** rng.uniform(-8.0, 12.0, len(row))
    weight = np.zeros((5, 5))
    weight[row[:9], column[:9]] = ratio[:9]
    beta = belief_propagation(row, column, ratio)
    expected = tried(weight)[row[:9], column[:9]]
    assert np.allclose(beta[:9], expected, rtol=1e-9, atol=1e-12)
    assert np.allclose(beta[9:], ratio[9:] / (1.0 + ratio[9:].sum()), rtol=1e-9)


def test_components_are_solved_independently() -> None:
    rng = np.random.default_rng(7)
    row = np.concatenate([4 * block + np.array([0, 0, 1, 1, 2]) for block in range(300)])
    column = np.concatenate([4 * block + np.array([0, 1, 0, 1, 1]) for block in range(300)])
    cost = rng.normal(size=len(row)) - 1.0
    order = rng.permutation(len(row))
    together = np.empty(len(row), dtype=bool)
    together[order] = cheapest_assignment(row[order], column[order], cost[order])
    alone = [
        cheapest_assignment(row[k : k + 5], column[k : k + 5], cost[k : k + 5])
        for k in range(0, len(row), 5)
    ]
    assert np.array_equal(together, np.concatenate(alone))
