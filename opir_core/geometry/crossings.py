"""Times at which smooth functions of time change sign: sampled, then found by bisection.

A function that dips through zero and back between two samples is caught where it has an extremum
near zero there: a golden-section search finds the extremum, and with it both crossings. Of two such
dips in one step, one may be lost.
"""

from collections.abc import Callable
from typing import NamedTuple

import numpy as np

from opir_core.arrays import BoolArray, FloatArray, IntArray

#: A function of rows (k,) and times (k,), s, with values (k,): the row says which of several
#: functions is meant.
RowFunction = Callable[[IntArray, FloatArray], FloatArray]


class Crossings(NamedTuple):
    """Zero crossings, sorted by row, then time: row, time, s, and whether the function rises, each
    (k,).
    """

    row: IntArray
    time_s: FloatArray
    rises: BoolArray


class _Brackets(NamedTuple):
    """Intervals (k,) of rows, with the values at both ends."""

    row: IntArray
    start_s: FloatArray
    stop_s: FloatArray
    at_start: FloatArray
    at_stop: FloatArray

    @classmethod
    def joined(cls, groups: "list[_Brackets]") -> "_Brackets":
        row, *ends = (np.concatenate(columns) for columns in zip(*groups, strict=True))
        return cls(row.astype(np.int64), *ends)

    def take(self, rows: BoolArray | IntArray) -> "_Brackets":
        return _Brackets(self.row[rows], *(column[rows] for column in self[1:]))


def zero_crossings(
    function: RowFunction,
    start_s: FloatArray,
    stop_s: FloatArray,
    *,
    step_s: float,
    tolerance_s: float = 1e-3,
) -> Crossings:
    """Return where functions (n,) of time change sign between start and stop (n,), s, to within
    `tolerance_s`.

    Samples are at most `step_s` apart. Zero counts as positive; nan has no sign and
    no crossing beside it.
    """
    if not len(start_s):
        return Crossings(np.empty(0, dtype=np.int64), np.empty(0), np.empty(0, dtype=np.bool_))
    samples = _samples(function, start_s, stop_s, step_s)
    crossing = samples.take(
        ~_has_one_sign(samples) & np.isfinite(samples.at_start + samples.at_stop)
    )
    brackets = _Brackets.joined([crossing, *_around_extrema(function, samples, tolerance_s)])
    time_s = _bisected(function, brackets, tolerance_s)
    order = np.lexsort((time_s, brackets.row))
    return Crossings(
        brackets.row[order], time_s[order], (brackets.at_stop > brackets.at_start)[order]
    )


def intervals_below(
    function: Callable[[FloatArray], FloatArray],
    start_s: float,
    stop_s: float,
    *,
    step_s: float,
    tolerance_s: float = 1e-3,
) -> FloatArray:
    """Return the intervals (k, 2) of [start, stop] in which a function of time is negative, in
    order.

    Step and tolerance are those of `zero_crossings`.
    """
    if stop_s <= start_s:
        return np.empty((0, 2))
    ends = np.array([start_s]), np.array([stop_s])
    crossings = zero_crossings(
        lambda _, time_s: function(time_s), *ends, step_s=step_s, tolerance_s=tolerance_s
    )
    edges = np.concatenate([ends[0], crossings.time_s, ends[1]])
    # Between two crossings the sign is that of the middle.
    is_below = function(0.5 * (edges[:-1] + edges[1:])) < 0.0
    padded = np.concatenate([[False], is_below, [False]])
    starts = np.flatnonzero(~padded[:-1] & padded[1:])
    stops = np.flatnonzero(padded[:-1] & ~padded[1:])
    return np.stack([edges[starts], edges[stops]], axis=1)


def _samples(
    function: RowFunction, start_s: FloatArray, stop_s: FloatArray, step_s: float
) -> _Brackets:
    """Return the steps of all rows, in order, with the function at their ends."""
    rows = len(start_s)
    steps = max(2, int(np.ceil(np.max(stop_s - start_s, initial=0.0) / step_s)))
    share = np.arange(steps + 1) / steps
    time_s = start_s[:, None] + (stop_s - start_s)[:, None] * share
    row = np.repeat(np.arange(rows), steps + 1)
    value = function(row, time_s.ravel()).reshape(time_s.shape)
    ends = (time_s[:, :-1], time_s[:, 1:], value[:, :-1], value[:, 1:])
    return _Brackets(np.repeat(np.arange(rows), steps), *(column.ravel() for column in ends))


def _around_extrema(
    function: RowFunction, samples: _Brackets, tolerance_s: float
) -> list[_Brackets]:
    """Return the brackets of crossings in pairs, before and after an extremum between samples of
    one sign.
    """
    doubles = _nearest_to_zero(samples)
    if not len(doubles.row):
        return []
    # With one sign all along, the extremum of |f| that may lie beyond zero is the least of sign ·
    # f.
    sign = np.where(doubles.at_start < 0.0, -1.0, 1.0)
    middle, size = _least(
        lambda time_s: sign * function(doubles.row, time_s),
        doubles.start_s,
        doubles.stop_s,
        tolerance_s,
    )
    value = sign * size
    beyond = np.flatnonzero((value < 0.0) != (sign < 0.0))
    down = _Brackets(doubles.row, doubles.start_s, middle, doubles.at_start, value)
    up = _Brackets(doubles.row, middle, doubles.stop_s, value, doubles.at_stop)
    return [down.take(beyond), up.take(beyond)]


def _least(
    function: Callable[[FloatArray], FloatArray],
    low: FloatArray,
    high: FloatArray,
    tolerance_s: float,
) -> tuple[FloatArray, FloatArray]:
    """Return the times (k,) of the minima of functions in intervals, and their values, by
    golden-section search.
    """
    share = (np.sqrt(5.0) - 1.0) / 2.0
    inner = high - share * (high - low)
    outer = low + share * (high - low)
    at_inner = function(inner)
    at_outer = function(outer)
    for _ in range(_iterations(high - low, tolerance_s, share)):
        is_left = at_inner < at_outer
        low = np.where(is_left, low, inner)
        high = np.where(is_left, outer, high)
        # One of the two inner points stays inside; the other is new.
        probe = np.where(is_left, high - share * (high - low), low + share * (high - low))
        at_probe = function(probe)
        next_outer = np.where(is_left, inner, probe)
        at_next_outer = np.where(is_left, at_inner, at_probe)
        inner = np.where(is_left, probe, outer)
        at_inner = np.where(is_left, at_probe, at_outer)
        outer = next_outer
        at_outer = at_next_outer
    return np.where(at_inner < at_outer, inner, outer), np.minimum(at_inner, at_outer)


def _nearest_to_zero(samples: _Brackets) -> _Brackets:
    """Return the intervals of one or two steps with an extremum that may lie beyond zero, all of
    one sign.

    The extremum of a parabola or of a corner is at most as far from the nearest sample as that is
    from its neighbours.
    """
    tail = np.flatnonzero(np.diff(samples.row, append=-1) != 0)
    head = np.concatenate([[0], tail[:-1] + 1])
    one_sign = _has_one_sign(samples)
    size = np.abs(samples.at_start)
    next_size = np.abs(samples.at_stop)
    rise = np.abs(next_size - size)
    # At the ends of a row the extremum is beside the outermost sample, in one step.
    at_head = size[head] <= np.minimum(next_size[head], np.maximum(rise[head], rise[head + 1]))
    at_tail = next_size[tail] <= np.minimum(size[tail], np.maximum(rise[tail], rise[tail - 1]))
    outer = np.concatenate([head[at_head], tail[at_tail]])
    single = samples.take(outer[one_sign[outer]])
    step = np.delete(np.arange(len(size)), tail)
    step = step[one_sign[step] & one_sign[step + 1]]
    dip = next_size[step]
    # Of two equal samples beside a dip only one is its nearest; in the first step that is the
    # outermost.
    is_equal_nearest = np.isin(step, head, invert=True) & (dip == size[step])
    is_lowest = ((dip < size[step]) | is_equal_nearest) & (dip < next_size[step + 1])
    start = step[is_lowest & (dip <= np.maximum(rise[step], rise[step + 1]))]
    ends = samples.take(start + 1)
    double = samples.take(start)._replace(stop_s=ends.stop_s, at_stop=ends.at_stop)
    return _Brackets.joined([single, double])


def _bisected(function: RowFunction, brackets: _Brackets, tolerance_s: float) -> FloatArray:
    """Return the times (k,) at which a function changes sign in brackets."""
    low = brackets.start_s
    high = brackets.stop_s
    for _ in range(_iterations(high - low, tolerance_s, 0.5)):
        middle = 0.5 * (low + high)
        is_before = (function(brackets.row, middle) < 0.0) == (brackets.at_start < 0.0)
        low = np.where(is_before, middle, low)
        high = np.where(is_before, high, middle)
    return 0.5 * (low + high)


def _has_one_sign(brackets: _Brackets) -> BoolArray:
    """Return which brackets have finite values of one sign at both ends."""
    same_sign = (brackets.at_start < 0.0) == (brackets.at_stop < 0.0)
    return same_sign & np.isfinite(brackets.at_start + brackets.at_stop)


def _iterations(width_s: FloatArray, tolerance_s: float, share: float) -> int:
    """Return how often an interval is reduced to a share of itself until it is as short as the
    tolerance.
    """
    widest = float(np.max(width_s, initial=0.0))
    return (
        0 if widest <= tolerance_s else int(np.ceil(np.log(tolerance_s / widest) / np.log(share)))
    )
