"""Local polynomials through tables of states in Newton's form, for many tables at once.

Between two states the polynomial is that through the nearest states: four with their velocities
(degree 7), or six positions alone (degree 5); fewer where a smooth run has fewer. With velocities,
the two ends alone (degree 3) where states are much closer to each other than these. It never
extends across the end of a run.
"""

from collections.abc import Iterable, Sequence
from typing import NamedTuple

import numpy as np
from attrs import evolve, frozen

from opir_core.arrays import FloatArray, RowArray
from opir_core.plugin import StateTable
from opir_readers.frames import lengths

#: States through which a polynomial goes: with velocities, and positions alone.
_WITH_VELOCITY = 4
_WITHOUT_VELOCITY = 6

#: Coefficients of Newton's form, for all intervals.
_TERMS = 2 * _WITH_VELOCITY


class _Intervals(NamedTuple):
    """Intervals in order of time: starts and lengths (m,), s, and Newton's form over them."""

    start_s: FloatArray
    length_s: FloatArray
    nodes: FloatArray
    coefficients: FloatArray


@frozen(eq=False)
class Interpolant:
    """Polynomials over the intervals (m,) of n tables: table by table, in order of time.

    `first` (n + 1,) is where each table's intervals begin, `start_s` (m,) and `length_s` (m,) are
    the intervals, `nodes` (8, m) and `coefficients` (8, m, 3) Newton's form in time since the
    start, in lengths.
    """

    first: RowArray
    start_s: FloatArray
    length_s: FloatArray
    nodes: FloatArray
    coefficients: FloatArray

    def state(self, table: RowArray, time_s: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return positions and velocities (k, 3) of tables (k,) at times (k,) within them."""
        interval = self._interval(table, time_s)
        length_s = self.length_s[interval]
        x = ((time_s - self.start_s[interval]) / length_s)[:, None]
        position = self.coefficients[-1].take(interval, axis=0)
        slope = np.zeros_like(position)
        for nodes, coefficients in zip(self.nodes[-2::-1], self.coefficients[-2::-1], strict=True):
            offset = x - nodes.take(interval)[:, None]
            slope = slope * offset + position
            position = position * offset + coefficients.take(interval, axis=0)
        return position, slope / length_s[:, None]

    def _interval(self, table: RowArray, time_s: FloatArray) -> RowArray:
        """Return the intervals (k,) of tables (k,) at times (k,)."""
        interval = np.empty(len(table), dtype=np.intp)
        for number in np.flatnonzero(np.bincount(table)).tolist():
            begin = self.first[number]
            starts_s = self.start_s[begin : self.first[number + 1]]
            rows = table == number
            place = np.searchsorted(starts_s, time_s[rows], side="right") - 1
            interval[rows] = begin + np.maximum(place, 0)
        return interval

    def at(self, time_s: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return positions and velocities (k, 3) of the only table at times (k,)."""
        return self.state(np.zeros(len(time_s), dtype=np.intp), time_s)


def rows_apart(time_s: FloatArray, step_s: float) -> RowArray:
    """Return the first row of each step of times (n,), s."""
    steps = np.floor((time_s - time_s[0]) / max(step_s, 1e-9) + 1e-6)
    return np.flatnonzero(np.diff(steps, prepend=-1.0) > 0.0)


def interpolant(tables: Sequence[StateTable]) -> Interpolant:
    """Return the polynomials of tables."""
    intervals = [
        _joined(_intervals_of_run(table, rows) for rows in runs(table) if len(rows) > 1)
        for table in tables
    ]
    first = np.cumsum([0, *(len(table.start_s) for table in intervals)])
    joined = _joined(intervals)
    # Contiguous, for `take` copies the whole of what is not.
    nodes = np.ascontiguousarray(joined.nodes)
    coefficients = np.ascontiguousarray(joined.coefficients)
    return Interpolant(first, joined.start_s, joined.length_s, nodes, coefficients)


def _joined(intervals: Iterable[_Intervals]) -> _Intervals:
    start_s, length_s, nodes, coefficients = zip(*intervals, strict=True)
    return _Intervals(
        np.concatenate(start_s),
        np.concatenate(length_s),
        np.concatenate(nodes, axis=1),
        np.concatenate(coefficients, axis=1),
    )


def largest_doubt_m(table: StateTable) -> float | None:
    """Return the largest distance between a state's position and the polynomial of the states about
    it without it.

    Between states the error is smaller still, by far where the motion is smooth. None where no
    stretch has three.
    """
    doubts = []
    for rows in runs(table):
        for parity in (0, 1):
            is_node = np.arange(len(rows)) % 2 == parity
            is_node[[0, -1]] = True
            omitted = rows[~is_node]
            if omitted.size:
                coarse = interpolant([_thinned(table, rows[is_node])])
                guess, _ = coarse.at(table.time_s[omitted])
                miss = guess - table.position_m[omitted]
                doubts.append(float(lengths(miss).max()))
    return max(doubts, default=None)


def _thinned(table: StateTable, rows: RowArray) -> StateTable:
    velocity = None if table.velocity_m_s is None else table.velocity_m_s[rows]
    return evolve(
        table,
        time_s=table.time_s[rows],
        position_m=table.position_m[rows],
        velocity_m_s=velocity,
        run=np.zeros(len(rows), np.intp),
    )


def runs(table: StateTable) -> list[RowArray]:
    """Return the rows of each run."""
    return np.split(np.arange(len(table.run)), np.flatnonzero(np.diff(table.run)) + 1)


def _intervals_of_run(table: StateTable, rows: RowArray) -> _Intervals:
    has_velocity = table.velocity_m_s is not None
    count = min(len(rows), _WITH_VELOCITY if has_velocity else _WITHOUT_VELOCITY)
    window = np.clip(np.arange(len(rows) - 1) - (count // 2 - 1), 0, len(rows) - count)
    states = rows[window[:, None] + np.arange(count)]
    start = table.time_s[rows[:-1]]
    length = table.time_s[rows[1:]] - start
    nodes, coefficients = _newton(table, states, start, length)
    if has_velocity and count > 2:
        # States nearer to each other than this share of an interval amplify the rounding of times
        # and positions.
        step = np.diff(table.time_s[states], axis=1).min(axis=1)
        uneven = np.flatnonzero(step < 0.125 * length)
        ends = rows[uneven[:, None] + np.arange(2)]
        nodes[:, uneven], coefficients[:, uneven] = _newton(
            table, ends, start[uneven], length[uneven]
        )
    return _Intervals(start, length, nodes, coefficients)


def _newton(
    table: StateTable, states: RowArray, start: FloatArray, length: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Return nodes (8, m) and coefficients (8, m, 3) of polynomials through states (m, k), each."""
    repeats = 1 if table.velocity_m_s is None else 2
    nodes = np.repeat((table.time_s[states] - start[:, None]) / length[:, None], repeats, axis=1).T
    values = np.repeat(table.position_m[states], repeats, axis=1).transpose(1, 0, 2)
    slopes = None
    if table.velocity_m_s is not None:
        slopes = table.velocity_m_s[states].transpose(1, 0, 2) * length[None, :, None]
    coefficients = _divided_differences(nodes, values, slopes)
    lacking = (0, _TERMS - len(nodes))
    return np.pad(nodes, (lacking, (0, 0))), np.pad(coefficients, (lacking, (0, 0), (0, 0)))


def _divided_differences(
    nodes: FloatArray, values: FloatArray, slopes: FloatArray | None
) -> FloatArray:
    """Return Newton's coefficients (k, m, 3); where nodes come in pairs, a pair's first difference
    is the slope.
    """
    coefficients = [values[0]]
    column = values
    for order in range(1, len(nodes)):
        gap = (nodes[order:] - nodes[:-order])[..., None]
        difference = column[1:] - column[:-1]
        if order == 1 and slopes is not None:
            gap[::2] = 1.0
            difference[::2] = slopes
        column = difference / gap
        coefficients.append(column[0])
    return np.stack(coefficients)
