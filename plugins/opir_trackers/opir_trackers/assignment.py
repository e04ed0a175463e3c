"""Global nearest neighbour: the cheapest one-to-one assignment on a sparse graph of gated pairs.

The graph falls into connected components that do not know of each other. Components of one row or one column are
settled by a minimum, small ones by trying all permutations, many components at once; only what is left goes through
`scipy.optimize.linear_sum_assignment`, a component at a time. So the cost grows with the gated pairs.
"""

from collections.abc import Iterator
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
