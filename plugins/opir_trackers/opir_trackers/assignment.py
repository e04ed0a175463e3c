"""One-to-one assignment on a sparse graph of gated pairs: the cheapest, and the probabilities of all.

The graph splits into independent connected components. The nearest-neighbour assignment takes a minimum in components
of one row or column, tries all permutations in small ones, many components at once, and uses
`scipy.optimize.linear_sum_assignment` for the rest. The cost grows with the number of gated pairs.

Association probabilities are sums over all one-to-one hypotheses; the weight of a hypothesis is the product of the
likelihood ratios of its pairs. Clusters are summed exactly by a forward and a backward pass over their rows, whose
states are the sets of columns used so far (efficient hypothesis management: Maskell, Briers and Wright, "Fast mutual
exclusion", 2004; Horridge and Maskell, "Real-time tracking of hundreds of targets with efficient exact JPDAF
implementation", Fusion 2006). Clusters wider than `_EXACT_WIDTH` are first approximated by loopy belief propagation
(Williams and Lau, "Approximate evaluation of marginal association probabilities with belief propagation", IEEE Trans.
AES 50(4), 2014); without their improbable pairs they are summed exactly where they have become narrow enough.
docs/design/association_probability_error.py measures the error of both.
"""

from collections.abc import Iterator
from functools import cache
from itertools import permutations

import numpy as np
from attrs import frozen

from opir_core.arrays import BoolArray, FloatArray, IntArray

#: Numbers are ranked by a table up to this many entries per number, and sorted beyond.
_DENSE = 8

#: Largest number of rows and columns for which all 24 permutations are tried.
_PERMUTED = 4


@frozen(eq=False)
class Blocks:
    """Connected components of one shape as dense arrays (k, r, c) of pair numbers, -1 for no pair.

    Row and column indices are local to the component.
    """

    pair: IntArray


def components(row: IntArray, column: IntArray) -> tuple[IntArray, int]:
    """Return the component (n,) of each pair of a bipartite graph, and the number of components.

    Rows and columns are whole numbers from 0; components are numbered by their first pair.
    """
    from scipy.sparse import csr_array
    from scipy.sparse.csgraph import connected_components

    if not len(row):
        return np.empty(0, dtype=np.int64), 0
    rows, columns = ranks(row), ranks(column)
    size = int(rows.max()) + 1
    total = size + int(columns.max()) + 1
    start = np.zeros(total + 1, dtype=np.int32)
    np.cumsum(np.bincount(rows, minlength=total), out=start[1:])
    ends = (columns + size).astype(np.int32)[np.argsort(rows, kind="stable")]
    graph = csr_array((np.ones(len(row)), ends, start), shape=(total, total))
    count, label = connected_components(graph, directed=False)
    component = label[rows].astype(np.int64)
    first, rank = np.empty((2, count), dtype=np.int64)
    # Of all that are put in one place the last stays.
    first[component[::-1]] = np.arange(len(row) - 1, -1, -1)
    rank[np.argsort(first)] = np.arange(count)
    return rank[component], count


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
    """Return the sorted distinct values of whole numbers from 0, none of which is many times their count."""
    kept: IntArray = np.flatnonzero(np.bincount(value))
    return kept


def unambiguous(row: IntArray, column: IntArray) -> BoolArray:
    """Return which pairs (n,) share neither row nor column with another pair."""
    if not len(row):
        return np.zeros(0, dtype=bool)
    single: BoolArray = (np.bincount(row)[row] == 1) & (np.bincount(column)[column] == 1)
    return single


def local_indices(component: IntArray, node: IntArray) -> tuple[IntArray, IntArray]:
    """Return the index of each pair's node within its component, and the number of nodes of each component.

    A node belongs to one component.
    """
    node = ranks(node)
    group = np.empty(int(node.max(initial=-1)) + 1, dtype=np.int64)
    group[node] = component
    sizes = np.bincount(group, minlength=int(component.max(initial=-1)) + 1)
    order = np.argsort(group, kind="stable")
    place = np.empty(len(group), dtype=np.int64)
    place[order] = np.arange(len(group)) - (np.cumsum(sizes) - sizes)[group[order]]
    return place[node], sizes.astype(np.int64)


def blocks(row: IntArray, column: IntArray, group: IntArray, count: int) -> Iterator[Blocks]:
    """Yield the components as dense arrays, grouped by shape."""
    row_place, rows = local_indices(group, row)
    column_place, columns = local_indices(group, column)
    shapes, shape_of = np.unique(np.stack([rows, columns], axis=1), axis=0, return_inverse=True)
    for number, (height, width) in enumerate(shapes.tolist()):
        mine = shape_of == number
        rank = np.cumsum(mine) - 1
        pairs = np.flatnonzero(mine[group])
        dense = np.full((int(mine.sum()), height, width), -1, dtype=np.int64)
        dense[rank[group[pairs]], row_place[pairs], column_place[pairs]] = pairs
        yield Blocks(dense)


def cheapest_assignment(row: IntArray, column: IntArray, cost: FloatArray) -> BoolArray:
    """Return which pairs (n,) the cheapest one-to-one assignment uses.

    `row`, `column` (n,) are the nodes of the gated pairs, each pair once. `cost` is that of the pair relative to
    leaving both nodes unassigned: pairs with a cost of 0 or more are never used. Ties go to the earlier row and column.
    """
    chosen = np.zeros(len(row), dtype=bool)
    useful = np.flatnonzero(cost < 0.0)
    alone = unambiguous(row[useful], column[useful])
    chosen[useful[alone]] = True
    useful = useful[~alone]
    if not len(useful):
        return chosen
    group, count = components(row[useful], column[useful])
    for block in blocks(row[useful], column[useful], group, count):
        chosen[useful[_cheapest(block.pair, cost[useful])]] = True
    return chosen


def _cheapest(pair: IntArray, cost: FloatArray) -> IntArray:
    """Return the pairs used in components (k, r, c) of pair numbers."""
    gain = np.where(pair >= 0, cost[pair], 0.0)
    _, height, width = pair.shape
    if min(height, width) == 1:
        flat = pair.reshape(len(pair), -1)
        single: IntArray = flat[np.arange(len(flat)), np.argmin(gain.reshape(len(pair), -1), axis=1)]
        return single
    if max(height, width) <= _PERMUTED:
        return _best_permutations(pair, gain)
    from scipy.optimize import linear_sum_assignment

    used = [single[linear_sum_assignment(costs)] for single, costs in zip(pair, gain, strict=True)]
    pairs: IntArray = np.concatenate(used)
    kept: IntArray = pairs[pairs >= 0]
    return kept


def _best_permutations(pair: IntArray, gain: FloatArray) -> IntArray:
    """Return the pairs used in components of at most 4 rows and columns, by trying all permutations."""
    if pair.shape[1] > pair.shape[2]:
        pair, gain = pair.transpose(0, 2, 1), gain.transpose(0, 2, 1)
    short, long = pair.shape[1:]
    orders = np.array(sorted({order[:short] for order in permutations(range(long))}))
    place = np.arange(short)
    total = gain[:, place[None, :], orders].sum(axis=2)
    best = orders[np.argmin(total, axis=1)]
    used: IntArray = pair[np.arange(len(pair))[:, None], place[None, :], best].ravel()
    kept: IntArray = used[used >= 0]
    return kept


#: Clusters with at most this many rows or columns are summed exactly: 2**8 states.
_EXACT_WIDTH = 8

#: Pairs of wide clusters less probable than this by belief propagation keep that probability.
_NEGLIGIBLE = 1e-3

#: Belief propagation stops once no message changes by more than this, or after the given number of sweeps.
_CONVERGED = 1e-4
_SWEEPS = 50


def marginals(row: IntArray, column: IntArray, ratio: FloatArray) -> FloatArray:
    """Return the association probability (n,) of each pair.

    `row`, `column` (n,) are the nodes of the gated pairs, each pair once; `ratio` (n,) is the likelihood ratio of the
    pair to both nodes being unassigned, finite and not negative. One minus the sum over a row is the probability that
    the row is unassigned.
    """
    beta = ratio / (1.0 + ratio)
    crowd = np.flatnonzero(~unambiguous(row, column))
    if len(crowd):
        wide = crowd[_narrow_marginals(row, column, ratio, crowd, beta)]
        if len(wide):
            beta[wide] = belief_propagation(row[wide], column[wide], ratio[wide])
            believed = wide[beta[wide] > _NEGLIGIBLE]
            _narrow_marginals(row, column, ratio, believed, beta)
    return beta


def _narrow_marginals(
    row: IntArray, column: IntArray, ratio: FloatArray, pairs: IntArray, beta: FloatArray
) -> BoolArray:
    """Write exact probabilities of `pairs` in narrow clusters to `beta`; return which (m,) are in wide ones."""
    group, count = components(row[pairs], column[pairs])
    row_place, rows = local_indices(group, row[pairs])
    column_place, columns = local_indices(group, column[pairs])
    flat = rows < columns
    line = np.where(flat[group], column_place, row_place)
    place = np.where(flat[group], row_place, column_place)
    width, height = np.minimum(rows, columns), np.maximum(rows, columns)
    for size in distinct(width[width <= _EXACT_WIDTH]).tolist():
        clusters = np.flatnonzero(width == size)
        rank = np.full(count, -1, dtype=np.int64)
        rank[clusters] = np.arange(len(clusters))
        mine = np.flatnonzero(rank[group] >= 0)
        cluster = rank[group[mine]], line[mine], place[mine]
        weight = np.zeros((len(clusters), int(height[clusters].max()), size))
        weight[cluster] = ratio[pairs[mine]]
        beta[pairs[mine]] = exact_marginals(weight)[cluster]
    unsettled: BoolArray = (width > _EXACT_WIDTH)[group]
    return unsettled


def exact_marginals(weight: FloatArray) -> FloatArray:
    """Return the association probabilities (k, r, c) of clusters of likelihood ratios (k, r, c), 0 for no pair.

    Time and memory grow with c 2**c.
    """
    count, height, width = weight.shape
    if width == 1:
        lone_column: FloatArray = weight / (1.0 + weight.sum(axis=1, keepdims=True))
        return lone_column
    alone = 1.0 / np.maximum(weight.max(axis=2), 1.0)
    share = weight * alone[:, :, None]
    more, less = _neighbours(width)
    before = np.zeros((height, count, 2**width + 1))
    before[0, :, 0] = 1.0
    for row in range(height - 1):
        state = before[row]
        fresh = alone[:, row, None] * state
        fresh[:, :-1] += (state.take(less, axis=1) @ share[:, row, :, None])[:, :, 0]
        np.divide(fresh, np.maximum.reduce(fresh, axis=1)[:, None], out=before[row + 1])
    beta, after = np.empty_like(weight), np.ones((count, 2**width + 1))
    after[:, -1] = 0.0
    for row in range(height - 1, -1, -1):
        first, used = before[row, :, :-1], after.take(more, axis=1)
        fresh = alone[:, row, None] * after[:, :-1]
        chance = share[:, row] * (first[:, None] @ used)[:, 0]
        chance /= (np.add.reduce(first * fresh, axis=1) + np.add.reduce(chance, axis=1))[:, None]
        beta[:, row] = chance
        fresh += (used @ share[:, row, :, None])[:, :, 0]
        np.divide(fresh, np.maximum.reduce(fresh, axis=1)[:, None], out=after[:, :-1])
    return beta


@cache
def _neighbours(width: int) -> tuple[IntArray, IntArray]:
    """Return for each set of columns and each column (2**c, c) the set with the column added, and with it removed.

    Impossible additions and removals have the number 2**c, of no set.
    """
    sets, bit = np.arange(2**width)[:, None], 1 << np.arange(width)
    held = (sets & bit) > 0
    return np.where(held, 2**width, sets | bit), np.where(held, sets ^ bit, 2**width)


def belief_propagation(row: IntArray, column: IntArray, ratio: FloatArray, sweeps: int = _SWEEPS) -> FloatArray:
    """Return approximate association probabilities (n,) by loopy belief propagation, linear in the pairs.

    It is exact without loops. With loops of strong evidence it is overconfident in the likeliest hypothesis.
    """
    line, place = ranks(row), ranks(column)
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
    rest: FloatArray = np.where(most, np.bincount(node, np.where(most, 0.0, value))[node], total - value)
    return rest
