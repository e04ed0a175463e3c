"""One-to-one assignment on a sparse graph of gated pairs: the cheapest, and the probabilities of
all.

Pairs that share neither row nor column with another one are settled at once; the rest is a dense
problem for `scipy.optimize.linear_sum_assignment`, some connected components at a time.

Association probabilities are sums over all one-to-one hypotheses; the weight of a hypothesis is the
product of the likelihood ratios of its pairs. They are approximated by loopy belief propagation
(Williams and Lau, "Approximate evaluation of marginal association probabilities with belief
propagation", IEEE Trans. AES 50(4), 2014), which is exact where the graph has no loops.
"""

import numpy as np

from opir_core.arrays import BoolArray, FloatArray, IntArray

#: Numbers are ranked by a table up to this many entries per number, and sorted beyond.
_DENSE = 8

#: Components are solved together up to about this number of pairs: calls for fewer, and empty
#: elements for more, take longer.
_TOGETHER = 200


def components(row: IntArray, column: IntArray) -> tuple[IntArray, int]:
    """Return the component (n,), from 0, of each pair of a bipartite graph, and the number of
    components.

    Rows and columns are whole numbers from 0; components are numbered by their lowest rows.
    """
    rows = ranks(row)
    columns = ranks(column)
    label = np.arange(int(rows.max(initial=-1)) + 1)
    lowest = np.empty(int(columns.max(initial=-1)) + 1, dtype=np.int64)
    while True:
        lowest.fill(len(label))
        np.minimum.at(lowest, columns, label[rows])
        fresh = label.copy()
        np.minimum.at(fresh, rows, lowest[columns])
        # The label of a label is of the same component, and halves the way to its lowest row.
        fresh = fresh[fresh]
        if np.array_equal(fresh, label):
            break
        label = fresh
    component = ranks(label)[rows]
    return component, int(component.max(initial=-1)) + 1


def ranks(value: IntArray) -> IntArray:
    """Return the rank (n,), from 0, of each whole number among the distinct ones."""
    top = int(value.max(initial=-1)) + 1
    if top > _DENSE * len(value):
        rank: IntArray = np.unique(value, return_inverse=True)[1].astype(np.int64)
        return rank
    there = np.zeros(top, dtype=np.int64)
    there[value] = 1
    place: IntArray = (np.cumsum(there) - 1)[value]
    return place


def distinct(value: IntArray) -> IntArray:
    """Return the sorted distinct values of whole numbers from 0, none of which is many times their
    count.
    """
    kept: IntArray = np.flatnonzero(np.bincount(value))
    return kept


def group_sums(group: IntArray, columns: FloatArray, count: int = 0) -> FloatArray:
    """Return the sums (count, k), or of as many groups as there are, of columns (n, k) by group
    (n,), from 0.
    """
    sums = np.stack([np.bincount(group, column, count) for column in columns.T], axis=1)
    return sums.astype(np.float64, copy=False)


def unambiguous(row: IntArray, column: IntArray) -> BoolArray:
    """Return which pairs (n,) share neither row nor column with another pair."""
    if not len(row):
        return np.zeros(0, dtype=bool)
    single: BoolArray = (np.bincount(row)[row] == 1) & (np.bincount(column)[column] == 1)
    return single


def cheapest_assignment(row: IntArray, column: IntArray, cost: FloatArray) -> BoolArray:
    """Return which pairs (n,) the cheapest one-to-one assignment uses.

    `row`, `column` (n,) are the nodes of the gated pairs, each pair once. `cost` is that of the
    pair relative to leaving both nodes unassigned: pairs with a cost of 0 or more are never used.
    """
    chosen = np.zeros(len(row), dtype=bool)
    useful = np.flatnonzero(cost < 0.0)
    alone = unambiguous(row[useful], column[useful])
    chosen[useful[alone]] = True
    rest = useful[~alone]
    if not len(rest):
        return chosen
    group, count = components(row[rest], column[rest])
    # Numbered component by component, each and a few together are blocks of one matrix.
    rows = ranks(group * (int(row.max()) + 1) + row[rest])
    columns = ranks(group * (int(column.max()) + 1) + column[rest])
    order = np.argsort(group, kind="stable")
    first = np.cumsum(np.bincount(group, minlength=count)) // _TOGETHER
    cuts = np.flatnonzero(np.diff(first[group[order]])) + 1
    for part in np.split(order, cuts):
        used = _cheapest(
            rows[part] - rows[part].min(), columns[part] - columns[part].min(), cost[rest[part]]
        )
        chosen[rest[part[used]]] = True
    return chosen


def _cheapest(row: IntArray, column: IntArray, cost: FloatArray) -> IntArray:
    """Return the pairs used of rows and columns without gaps, by a dense matrix."""
    from scipy.optimize import linear_sum_assignment

    pair = np.full((int(row.max()) + 1, int(column.max()) + 1), -1)
    pair[row, column] = np.arange(len(row))
    costs = np.zeros(pair.shape)
    costs[row, column] = cost
    used: IntArray = pair[linear_sum_assignment(costs)]
    return used[used >= 0]


#: Belief propagation stops once no message changes by more than this, or after the given number of
#: sweeps.
_CONVERGED = 1e-4
_SWEEPS = 50

#: Likelihoods are scaled until none changes by more than this share.
_SETTLED = 0.01


def swap_probabilities(
    row: IntArray, column: IntArray, log: FloatArray, sweeps: int = 300
) -> FloatArray:
    """Return approximate association probabilities (n,) where every row has a column, by log
    likelihoods (n,).

    The squared likelihoods are scaled until no row and no column has more than 1 in all (Sinkhorn,
    Ann. Math. Stat. 35(2), 1964). That is exact where two rows may have swapped their columns; of
    more rows the error is 0.03 in the mean (docs/design/association_probability_error.py).
    """
    log = 2.0 * log
    for _ in range(sweeps):
        before = log
        log = log - _log_sums(row, log)
        log = log - np.maximum(_log_sums(column, log), 0.0)
        # What is improbable now may take over: logarithms settle last.
        if np.max(np.abs(log - before), initial=0.0) < _SETTLED:
            break
    return np.exp(log)


def _log_sums(node: IntArray, log: FloatArray) -> FloatArray:
    """Return for each pair (n,) the logarithm of the sum over the pairs of its node."""
    most = np.full(int(node.max(initial=-1)) + 1, -np.inf)
    np.maximum.at(most, node, log)
    total = np.bincount(node, np.exp(log - most[node]))
    sums: FloatArray = np.log(total[node]) + most[node]
    return sums


def belief_propagation(
    row: IntArray, column: IntArray, ratio: FloatArray, sweeps: int = _SWEEPS
) -> FloatArray:
    """Return approximate association probabilities (n,) by loopy belief propagation, linear in the
    pairs.

    It is exact without loops. With loops of strong evidence it is overconfident in the likeliest
    hypothesis.
    """
    line = ranks(row)
    place = ranks(column)
    to_row = np.ones(len(ratio))
    for _ in range(sweeps):
        fresh = 1.0 / (1.0 + _others(place, ratio / (1.0 + _others(line, ratio * to_row))))
        settled = np.max(np.abs(fresh - to_row), initial=0.0) < _CONVERGED
        to_row = fresh
        if settled:
            break
    seen = ratio * to_row
    beta: FloatArray = seen / (1.0 + np.bincount(line, seen)[line])
    return beta


def _others(node: IntArray, value: FloatArray) -> FloatArray:
    """Return the sums (n,) of the values of all other pairs of each pair's node.

    A pair with more than half of its node's sum is excluded before summing, not subtracted after.
    """
    total = np.bincount(node, value)[node]
    most = value > 0.5 * total
    rest: FloatArray = np.where(
        most, np.bincount(node, np.where(most, 0.0, value))[node], total - value
    )
    return rest
