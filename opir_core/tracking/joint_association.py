"""Joint probabilistic association: how probable each gated pair is, with all one-to-one explanations weighed.

The weight of an explanation is the product of the likelihood ratios of the pairs it uses. Clusters (connected
components of the gated graph) are independent. Small ones are enumerated, many at once. Larger ones are summed exactly
by a forward and a backward pass over their rows, whose states are the sets of columns used so far among those that rows
still to come can use: the merging of equal subproblems of efficient hypothesis management (Maskell, Briers and Wright,
"Fast mutual exclusion", 2004; Horridge and Maskell, "Real-time tracking of hundreds of targets with efficient exact
JPDAF implementation", Fusion 2006). Clusters whose widest set exceeds `EXACT_WIDTH` columns are approximated by loopy
belief propagation (Williams and Lau, "Approximate evaluation of marginal association probabilities with belief
propagation", IEEE Trans. AES 50(4), 2014), whose error docs/design/joint_association_error.py measures.
"""

from functools import lru_cache
from itertools import product
from typing import Any

import numpy as np

from opir_core.records import FloatArray, IntArray
from opir_core.tracking.assignment import blocks, components, lone

#: A cluster is summed exactly as long as no more than this many columns are open at once: at most 2**12 states a row.
EXACT_WIDTH = 12

#: Clusters up to this many rows and columns are enumerated: 209 explanations.
_ENUMERATED = 4

_SWEEPS = 200
_SETTLED = 1e-10


def marginals(row: IntArray, column: IntArray, ratio: FloatArray, exact_width: int = EXACT_WIDTH) -> FloatArray:
    """Return the probability (n,) of each pair.

    `row`, `column` (n,) are the nodes of the gated pairs, each pair once; `ratio` (n,) is the likelihood that the pair
    belongs together over that of both being alone, finite and not negative. What a row's pairs leave to 1 is the
    probability that it has none.
    """
    beta = ratio / (1.0 + ratio)
    crowd = np.flatnonzero(~lone(row, column))
    if not len(crowd):
        return beta
    group, count = components(row[crowd], column[crowd])
    for block in blocks(row[crowd], column[crowd], group, count):
        here = block.pair >= 0
        pair = crowd[block.pair]
        weights = np.where(here, ratio[pair], 0.0)
        beta[pair[here]] = _block_marginals(weights, exact_width)[here]
    return beta


def _block_marginals(weight: FloatArray, exact_width: int) -> FloatArray:
    """Return the marginals (k, r, c) of clusters of one shape."""
    height, width = weight.shape[1:]
    if min(height, width) == 1:
        alone: FloatArray = weight / (1.0 + weight.sum(axis=(1, 2), keepdims=True))
        return alone
    if max(height, width) <= _ENUMERATED:
        return _enumerated(weight)
    return np.stack([cluster_marginals(single, exact_width) for single in weight])


@lru_cache(maxsize=16)
def _explanations(height: int, width: int) -> IntArray:
    """Return all one-to-one explanations as the column of each row, `width` for none."""
    every = product(range(width + 1), repeat=height)
    lawful = [e for e in every if len({c for c in e if c < width}) == sum(c < width for c in e)]
    return np.array(lawful, dtype=np.int64)


def _enumerated(weight: FloatArray) -> FloatArray:
    count, height, width = weight.shape
    explanation = _explanations(height, width)
    padded = np.concatenate([weight, np.ones((count, height, 1))], axis=2)
    each = padded[:, np.arange(height)[None, :], explanation]
    total = each.prod(axis=2)
    total /= total.sum(axis=1, keepdims=True)
    beta = np.zeros((count, height, width))
    for line, place in product(range(height), range(width)):
        beta[:, line, place] = total[:, explanation[:, line] == place].sum(axis=1)
    return beta


def cluster_marginals(weight: FloatArray, exact_width: int = EXACT_WIDTH) -> FloatArray:
    """Return the marginals (r, c) of one cluster of likelihood ratios (r, c), 0 where there is no pair."""
    order = _row_order(weight > 0.0)
    ordered = weight[order]
    beta = np.empty_like(weight)
    wide = _frontier_width(ordered > 0.0) > exact_width
    beta[order] = propagated_marginals(ordered) if wide else _summed(ordered)
    return beta


def _row_order(linked: np.ndarray) -> IntArray:
    """Return rows in an order that opens few columns at a time: always the row that adds the fewest new ones."""
    left, opened, order = set(range(len(linked))), np.zeros(linked.shape[1], dtype=bool), []
    while left:
        best = min(left, key=lambda row: (int((linked[row] & ~opened).sum()), -int((linked[row] & opened).sum()), row))
        order.append(best)
        left.remove(best)
        opened |= linked[best]
    return np.array(order, dtype=np.int64)


def _spans(linked: np.ndarray) -> tuple[IntArray, IntArray]:
    """Return the first and the last row of each column."""
    return np.argmax(linked, axis=0), len(linked) - 1 - np.argmax(linked[::-1], axis=0)


def _frontier_width(linked: np.ndarray) -> int:
    first, last = _spans(linked)
    rows = np.arange(len(linked))[:, None]
    return int(((first <= rows) & (rows <= last)).sum(axis=1).max())


def _summed(weight: FloatArray) -> FloatArray:
    """Return exact marginals by a forward and a backward pass; one axis of 2 (free, used) for each open column."""
    linked = weight > 0.0
    first, last = _spans(linked)
    opened: list[list[int]] = []
    before: list[FloatArray] = []
    axes: list[int] = []
    state = np.ones(())
    for row in range(len(weight)):
        state, axes = _with_columns(state, axes, np.flatnonzero(first == row).tolist())
        opened.append(list(axes))
        before.append(state)
        state = _stepped(state, axes, weight[row])
        state, axes = _without_columns(state, axes, [c for c in axes if last[c] == row])
        state = state / state.sum()
    return _read_backwards(weight, opened, before)


def _read_backwards(weight: FloatArray, opened: list[list[int]], before: list[FloatArray]) -> FloatArray:
    beta = np.zeros_like(weight)
    value, known = np.ones(()), list[int]()
    for row in range(len(weight) - 1, -1, -1):
        axes = opened[row]
        after = _spread(value, known, axes)
        joint = before[row] * after
        total = joint.sum()
        then = after.copy()
        for column in np.flatnonzero(weight[row] > 0.0).tolist():
            axis = axes.index(column)
            free, used = _ends(before[row], axis)[0], _ends(after, axis)[1]
            beta[row, column] = weight[row, column] * float((free * used).sum())
            _ends(then, axis)[0][...] += weight[row, column] * used
            total += beta[row, column]
        beta[row] /= total
        fresh = [c for c in axes if row == 0 or c not in opened[row - 1]]
        value, known = _closed(then, axes, fresh)
        value = value / value.max()
    return beta


def _ends(state: FloatArray, axis: int) -> tuple[FloatArray, FloatArray]:
    """Return views of the states in which a column is free, and in which it is used."""
    free: Any = (*(slice(None),) * axis, 0, Ellipsis)
    used: Any = (*(slice(None),) * axis, 1, Ellipsis)
    return state[free], state[used]


def _with_columns(state: FloatArray, axes: list[int], fresh: list[int]) -> tuple[FloatArray, list[int]]:
    for _ in fresh:
        state = np.stack([state, np.zeros_like(state)], axis=-1)
    return state, axes + fresh


def _without_columns(state: FloatArray, axes: list[int], done: list[int]) -> tuple[FloatArray, list[int]]:
    return state.sum(axis=tuple(axes.index(c) for c in done)), [c for c in axes if c not in done]


def _stepped(state: FloatArray, axes: list[int], weight: FloatArray) -> FloatArray:
    after = state.copy()
    for column in np.flatnonzero(weight > 0.0).tolist():
        axis = axes.index(column)
        _ends(after, axis)[1][...] += weight[column] * _ends(state, axis)[0]
    return after


def _spread(value: FloatArray, known: list[int], axes: list[int]) -> FloatArray:
    """Return the values of later rows over the open columns; what is closed after this row no longer matters."""
    kept = [c for c in axes if c in known]
    ordered = value.transpose([known.index(c) for c in kept])
    shape = [2 if c in known else 1 for c in axes]
    return np.array(np.broadcast_to(ordered.reshape(shape), (2,) * len(axes)))


def _closed(state: FloatArray, axes: list[int], fresh: list[int]) -> tuple[FloatArray, list[int]]:
    """Return the values with the columns that open at this row taken as free."""
    index = tuple(0 if c in fresh else slice(None) for c in axes)
    return state[index], [c for c in axes if c not in fresh]


def propagated_marginals(weight: FloatArray) -> FloatArray:
    """Return approximate marginals (r, c) of one cluster, by loopy belief propagation; it always converges."""
    to_row = np.ones_like(weight)
    for _ in range(_SWEEPS):
        seen = weight * to_row
        to_column = weight / (1.0 + seen.sum(axis=1, keepdims=True) - seen)
        fresh = 1.0 / (1.0 + to_column.sum(axis=0, keepdims=True) - to_column)
        settled = np.max(np.abs(fresh - to_row)) < _SETTLED
        to_row = fresh
        if settled:
            break
    seen = weight * to_row
    beta: FloatArray = seen / (1.0 + seen.sum(axis=1, keepdims=True))
    return beta
