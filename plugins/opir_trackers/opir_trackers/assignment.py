"""Global nearest neighbour: the cheapest one-to-one assignment on a sparse graph of gated pairs.

The graph falls into connected components that do not know of each other. Components of one row or one column are
settled by a minimum, small ones by trying all permutations, many components at once; only what is left goes through
`scipy.optimize.linear_sum_assignment`, a component at a time. So the cost grows with the gated pairs.

Joint probabilistic association: how probable each gated pair is, with all one-to-one explanations weighed.

The weight of an explanation is the product of the likelihood ratios of the pairs it uses. Clusters (connected
components of the gated graph) are independent. They are summed exactly, many at once, by a forward and a backward pass
over their rows, whose states are the sets of columns used so far: the merging of equal subproblems of efficient
hypothesis management (Maskell, Briers and Wright, "Fast mutual exclusion", 2004; Horridge and Maskell, "Real-time
tracking of hundreds of targets with efficient exact JPDAF implementation", Fusion 2006). Clusters of more than
`EXACT_WIDTH` rows and columns are first approximated by loopy belief propagation (Williams and Lau, "Approximate
evaluation of marginal association probabilities with belief propagation", IEEE Trans. AES 50(4), 2014); what is left of
them once pairs that it hardly believes in are set aside is summed exactly where that has become narrow enough.
docs/design/joint_association_error.py measures what both cost.
"""

from collections.abc import Iterator
from functools import cache
from itertools import permutations

import numpy as np
from attrs import frozen

from opir_core.arrays import BoolArray, FloatArray, IntArray

#: Numbers are ranked by a table of all that there could be, up to so many a number there is, and sorted beyond.
_DENSE = 8

#: Components up to this many rows and columns are settled by trying all permutations: 24 of them.
_TRIED = 4


@frozen(eq=False)
class Blocks:
    """Connected components of one size class as dense arrays: (k, r, c) numbers of the pairs, -1 where there is none.

    Row and column indices of the arrays are places within a component.
    """

    pair: IntArray


def components(row: IntArray, column: IntArray) -> tuple[IntArray, int]:
    """Return the component (n,) of each pair of a bipartite graph, and how many components there are.

    Rows and columns are any whole numbers from 0; components are numbered by their first pair.
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
    """Return the place (n,) of each whole number, from 0, among the different ones in order."""
    top = int(value.max(initial=-1)) + 1
    if top > _DENSE * len(value):
        rank: IntArray = np.unique(value, return_inverse=True)[1].astype(np.int64)
        return rank
    there = np.zeros(top, dtype=np.int64)
    there[value] = 1
    place: IntArray = (np.cumsum(there) - 1)[value]
    return place


def different(value: IntArray) -> IntArray:
    """Return the different ones, in order, of whole numbers from 0, none of which is many times their count."""
    found: IntArray = np.flatnonzero(np.bincount(value))
    return found


def lone(row: IntArray, column: IntArray) -> BoolArray:
    """Return which pairs (n,) share neither their row nor their column with another."""
    if not len(row):
        return np.zeros(0, dtype=bool)
    single: BoolArray = (np.bincount(row)[row] == 1) & (np.bincount(column)[column] == 1)
    return single


def places(component: IntArray, node: IntArray) -> tuple[IntArray, IntArray]:
    """Return the place of each pair's node within its component, by node, and the number of nodes of each component.

    A node is in one component alone.
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
    """Yield the components as dense arrays, those of one shape together."""
    row_place, rows = places(group, row)
    column_place, columns = places(group, column)
    shapes, shape_of = np.unique(np.stack([rows, columns], axis=1), axis=0, return_inverse=True)
    for number, (height, width) in enumerate(shapes.tolist()):
        mine = shape_of == number
        rank = np.cumsum(mine) - 1
        pairs = np.flatnonzero(mine[group])
        dense = np.full((int(mine.sum()), height, width), -1, dtype=np.int64)
        dense[rank[group[pairs]], row_place[pairs], column_place[pairs]] = pairs
        yield Blocks(dense)


def nearest(row: IntArray, column: IntArray, cost: FloatArray) -> BoolArray:
    """Return which pairs (n,) the cheapest one-to-one assignment uses.

    `row`, `column` (n,) are the nodes of the gated pairs, each pair once, and `cost` what choosing the pair costs over
    leaving both its nodes alone: pairs that cost 0 or more are never used. Ties go to the earlier row and column.
    """
    chosen = np.zeros(len(row), dtype=bool)
    useful = np.flatnonzero(cost < 0.0)
    alone = lone(row[useful], column[useful])
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
    if max(height, width) <= _TRIED:
        return _tried(pair, gain)
    from scipy.optimize import linear_sum_assignment

    used = [single[linear_sum_assignment(costs)] for single, costs in zip(pair, gain, strict=True)]
    pairs: IntArray = np.concatenate(used)
    kept: IntArray = pairs[pairs >= 0]
    return kept


def _tried(pair: IntArray, gain: FloatArray) -> IntArray:
    """Return the pairs used in components of at most 4 rows and columns, by trying all permutations."""
    if pair.shape[1] > pair.shape[2]:
        pair, gain = pair.transpose(0, 2, 1), gain.transpose(0, 2, 1)
    short, long = pair.shape[1:]
    orders = np.array(sorted({order[:short] for order in permutations(range(long))}))
    place = np.arange(short)
    total = gain[:, place[None, :], orders].sum(axis=2)
    best = orders[np.argmin(total, axis=1)]
    used: IntArray = pair[np.arange(len(pair))[:, None], place[None, :], best].ravel()
    found: IntArray = used[used >= 0]
    return found


#: A cluster is summed exactly as long as it has no more rows, or no more columns, than this: 2**8 states.
EXACT_WIDTH = 8

#: Up to so many clusters of a width are summed as matrices, one by one.
_FEW_CLUSTERS = 16

#: Pairs of wide clusters that belief propagation believes in less than this keep its probability.
_HARDLY = 1e-3

#: Belief propagation stops once no message changes by more than this, or after so many sweeps.
_SETTLED = 1e-4
_SWEEPS = 50


def marginals(row: IntArray, column: IntArray, ratio: FloatArray, exact_width: int = EXACT_WIDTH) -> FloatArray:
    """Return the probability (n,) of each pair.

    `row`, `column` (n,) are the nodes of the gated pairs, each pair once; `ratio` (n,) is the likelihood that the pair
    belongs together over that of both being alone, finite and not negative. What a row's pairs leave to 1 is the
    probability that it has none.
    """
    beta = ratio / (1.0 + ratio)
    crowd = np.flatnonzero(~lone(row, column))
    if len(crowd):
        wide = crowd[_narrow_marginals(row, column, ratio, crowd, beta, exact_width)]
        if len(wide):
            beta[wide] = propagated(row[wide], column[wide], ratio[wide])
            believed = wide[beta[wide] > _HARDLY]
            _narrow_marginals(row, column, ratio, believed, beta, exact_width)
    return beta


def _narrow_marginals(
    row: IntArray, column: IntArray, ratio: FloatArray, pairs: IntArray, beta: FloatArray, exact_width: int
) -> BoolArray:
    """Put exact probabilities of those of `pairs` in narrow clusters into `beta`; return which (m,) are in no such."""
    group, count = components(row[pairs], column[pairs])
    row_place, rows = places(group, row[pairs])
    column_place, columns = places(group, column[pairs])
    flat = rows < columns
    line = np.where(flat[group], column_place, row_place)
    place = np.where(flat[group], row_place, column_place)
    width, height = np.minimum(rows, columns), np.maximum(rows, columns)
    for size in different(width[width <= exact_width]).tolist():
        clusters = np.flatnonzero(width == size)
        rank = np.full(count, -1, dtype=np.int64)
        rank[clusters] = np.arange(len(clusters))
        mine = np.flatnonzero(rank[group] >= 0)
        spot = rank[group[mine]], line[mine], place[mine]
        weight = np.zeros((len(clusters), int(height[clusters].max()), size))
        weight[spot] = ratio[pairs[mine]]
        beta[pairs[mine]] = exact_marginals(weight)[spot]
    unsettled: BoolArray = (width > exact_width)[group]
    return unsettled


def exact_marginals(weight: FloatArray) -> FloatArray:
    """Return the probabilities (k, r, c) of clusters of likelihood ratios (k, r, c), 0 where there is no pair.

    Time and memory grow with c 2**c. A cluster costs nothing beyond its last row that has pairs.
    """
    count, height, width = weight.shape
    if width == 1:
        lone_column: FloatArray = weight / (1.0 + weight.sum(axis=1, keepdims=True))
        return lone_column
    if count <= _FEW_CLUSTERS:
        return _few_marginals(weight)
    rows = np.max(np.where(weight.any(axis=2), np.arange(1, height + 1), 0), axis=1)
    order = np.argsort(-rows, kind="stable")
    live = np.count_nonzero(rows[:, None] > np.arange(height), axis=0).tolist()
    ordered = np.ascontiguousarray(weight[order].transpose(1, 2, 0))
    alone = 1.0 / np.maximum(ordered.max(axis=1), 1.0)
    share = ordered * alone[:, None]
    more, less = _neighbours(width)
    beta = np.zeros_like(share)
    after = np.zeros((2**width + 1, count))
    after[:-1] = 1.0
    before = _forward(alone, share, live, less)
    for row in range(height - 1, -1, -1):
        some = live[row]
        part, then = share[row, :, :some], after[:, :some]
        first, used = before[row][:-1, :some], then.take(more, axis=0)
        fresh = alone[row, :some] * then[:-1]
        chance = np.multiply(part, np.add.reduce(first[:, None] * used, axis=0), out=beta[row, :, :some])
        chance /= np.add.reduce(first * fresh, axis=0) + np.add.reduce(chance, axis=0)
        fresh += np.add.reduce(part * used, axis=1)
        np.divide(fresh, np.maximum.reduce(fresh, axis=0), out=then[:-1])
    out = np.empty_like(weight)
    out[order] = beta.transpose(2, 0, 1)
    return out


def _forward(alone: FloatArray, share: FloatArray, live: list[int], less: IntArray) -> list[FloatArray]:
    """Return for each row the weights (2**c + 1, k) of all explanations of the rows before it, by the columns they use.

    `alone` (r, k) and `share` (r, c, k) weigh a row that has no column, or each; the first `live` clusters have it.
    """
    width, count = share.shape[1:]
    state = np.zeros((2**width + 1, count))
    state[0] = 1.0
    before = [state]
    for row, some in enumerate(live[:-1]):
        state = before[row][:, :some]
        fresh = alone[row, :some] * state
        fresh[:-1] += np.add.reduce(share[row, :, :some] * state.take(less, axis=0), axis=1)
        fresh /= np.maximum.reduce(fresh, axis=0)
        before.append(fresh)
    return before


def _few_marginals(weight: FloatArray) -> FloatArray:
    """Return what `exact_marginals` does, of so few clusters that each is sooner a matrix of its own."""
    count, height, width = weight.shape
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
    """Return for each set of columns and each column (2**c, c) the set with it as well, and the set without it.

    Where the set has the column already, or has it not, that is the number of a set there is none of, 2**c.
    """
    sets, bit = np.arange(2**width)[:, None], 1 << np.arange(width)
    held = (sets & bit) > 0
    return np.where(held, 2**width, sets | bit), np.where(held, sets ^ bit, 2**width)


def propagated(row: IntArray, column: IntArray, ratio: FloatArray, sweeps: int = _SWEEPS) -> FloatArray:
    """Return approximate probabilities (n,) of pairs by loopy belief propagation; a sweep costs so much a pair.

    On a graph without loops it is exact. With loops of strong evidence it believes too much in the likeliest
    explanation.
    """
    line, place = ranks(row), ranks(column)
    to_row = np.ones(len(ratio))
    for _ in range(sweeps):
        fresh = 1.0 / (1.0 + _others(place, ratio / (1.0 + _others(line, ratio * to_row))))
        settled = np.max(np.abs(fresh - to_row), initial=0.0) < _SETTLED
        to_row = fresh
        if settled:
            break
    seen = ratio * to_row
    beta: FloatArray = seen / (1.0 + np.bincount(line, seen)[line])
    return beta


def _others(node: IntArray, value: FloatArray) -> FloatArray:
    """Return the sums (n,) of the values of all other pairs of each pair's node.

    A pair that holds more than half of its node's sum is left out before adding up, not taken off after.
    """
    total = np.bincount(node, value)[node]
    most = value > 0.5 * total
    rest: FloatArray = np.where(most, np.bincount(node, np.where(most, 0.0, value))[node], total - value)
    return rest
