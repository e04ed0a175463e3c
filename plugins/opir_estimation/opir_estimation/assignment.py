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

from opir_core.arrays import BoolArray, FloatArray, IndexArray, IntArray

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
        lower = label.copy()
        np.minimum.at(lower, rows, lowest[columns])
        # The label of a label is of the same component, and halves the way to its lowest row.
        lower = lower[lower]
        if np.array_equal(lower, label):
            break
        label = lower
    component = ranks(label)[rows]
    return component, int(component.max(initial=-1)) + 1


def ranks(value: IntArray) -> IntArray:
    """Return the rank (n,), from 0, of each whole number among the distinct ones."""
    top = int(value.max(initial=-1)) + 1
    # A table is faster than sorting up to 8 entries per number.
    if top > 8 * len(value):
        rank: IntArray = np.unique(value, return_inverse=True)[1].astype(np.int64)
        return rank
    present = np.zeros(top, dtype=np.int64)
    present[value] = 1
    return (np.cumsum(present) - 1)[value]


def group_sums(group: IntArray, columns: FloatArray, count: int = 0) -> FloatArray:
    """Return the sums (count, k), or of as many groups as there are, of columns (n, k) by group
    (n,), from 0.
    """
    sums = np.stack([np.bincount(group, column, count) for column in columns.T], axis=1)
    return sums.astype(np.float64, copy=False)


def group_minima(group: IntArray, value: FloatArray, count: int) -> FloatArray:
    """Return the least values (count,) of each group of values (n,), inf without any."""
    least = np.full(count, np.inf)
    np.minimum.at(least, group, value)
    return least


def group_maxima(group: IntArray, value: FloatArray, count: int) -> FloatArray:
    """Return the greatest values (count,) of each group of values (n,), -inf without any."""
    return -group_minima(group, -value, count)


def unambiguous(row: IntArray, column: IntArray) -> BoolArray:
    """Return which pairs (n,) share neither row nor column with another pair."""
    if not len(row):
        return np.zeros(0, dtype=bool)
    return (np.bincount(row)[row] == 1) & (np.bincount(column)[column] == 1)


def cheapest_assignment(row: IntArray, column: IntArray, cost: FloatArray) -> BoolArray:
    """Return which pairs (n,) the cheapest one-to-one assignment uses.

    `row`, `column` (n,) are the nodes of the gated pairs, each pair once. `cost` is that of the
    pair relative to leaving both nodes unassigned: pairs with a cost of 0 or more are never used.
    """
    used = np.zeros(len(row), dtype=bool)
    useful = np.flatnonzero(cost < 0.0)
    is_lone = unambiguous(row[useful], column[useful])
    used[useful[is_lone]] = True
    contested = useful[~is_lone]
    if len(contested):
        selected = _cheapest_by_blocks(row[contested], column[contested], cost[contested])
        used[contested[selected]] = True
    return used


def _cheapest_by_blocks(row: IntArray, column: IntArray, cost: FloatArray) -> IntArray:
    """Return the pairs used of nodes with several pairs."""
    group, count = components(row, column)
    # Numbered component by component, each and a few together are blocks of one matrix.
    rows = ranks(group * (int(row.max()) + 1) + row)
    columns = ranks(group * (int(column.max()) + 1) + column)
    order = np.argsort(group, kind="stable")
    block = np.cumsum(np.bincount(group, minlength=count)) // _TOGETHER
    cuts = np.flatnonzero(np.diff(block[group[order]])) + 1
    selected = [
        pairs[_cheapest(rows[pairs], columns[pairs], cost[pairs])]
        for pairs in np.split(order, cuts)
    ]
    return np.concatenate(selected)


def _cheapest(row: IntArray, column: IntArray, cost: FloatArray) -> IntArray:
    """Return the pairs used of rows and columns without gaps, by a dense matrix."""
    from scipy.optimize import linear_sum_assignment

    row = row - row.min()
    column = column - column.min()
    pair = np.full((int(row.max()) + 1, int(column.max()) + 1), -1)
    pair[row, column] = np.arange(len(row))
    costs = np.zeros(pair.shape)
    costs[row, column] = cost
    pairs_: IntArray = pair[linear_sum_assignment(costs)]
    return pairs_[pairs_ >= 0]


def belief_propagation(
    row: IntArray, column: IntArray, ratio: FloatArray, sweeps: int = 50
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
        message = 1.0 / (1.0 + _others(place, ratio / (1.0 + _others(line, ratio * to_row))))
        settled = np.max(np.abs(message - to_row), initial=0.0) < 1e-4
        to_row = message
        if settled:
            break
    scaled = ratio * to_row
    return scaled / (1.0 + np.bincount(line, scaled)[line])


def _others(node: IntArray, value: FloatArray) -> FloatArray:
    """Return the sums (n,) of the values of all other pairs of each pair's node.

    A pair with more than half of its node's sum is excluded before summing, not subtracted after.
    """
    total = np.bincount(node, value)[node]
    is_dominant = value > 0.5 * total
    return np.where(
        is_dominant, np.bincount(node, np.where(is_dominant, 0.0, value))[node], total - value
    )


def scan_numbers(sensor: IndexArray, scan: IntArray) -> IntArray:
    """Return a number (n,), from 0, for each sensor's scan."""
    if not len(scan):
        return np.empty(0, dtype=np.int64)
    since = scan - scan.min()
    return ranks(sensor * (since.max() + 1) + since)
