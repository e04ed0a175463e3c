"""Local polynomials through tables of states in Newton's form, for many tables at once.

Between two states the polynomial is that through the nearest states: four with their velocities
(degree 7), or six positions alone (degree 5); fewer where a smooth run has fewer. With velocities,
the two ends alone (degree 3) where states are much closer to each other than these. It never
extends across the end of a run.
"""

from collections.abc import Sequence

import numpy as np
from attrs import frozen

from opir_core.arrays import FloatArray, RowArray
from opir_core.plugin import StateTable

_WITH_VELOCITY = 4
_WITHOUT_VELOCITY = 6

#: States nearer to each other than this share of an interval amplify the rounding of times and
#: positions.
_EVEN = 0.125

#: Coefficients of Newton's form, for all intervals.
_TERMS = 2 * _WITH_VELOCITY


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
        row = np.empty(len(table), dtype=np.intp)
        for number in np.flatnonzero(np.bincount(table)).tolist():
            begin = self.first[number]
            end = self.first[number + 1]
            mine = table == number
            found = np.searchsorted(self.start_s[begin:end], time_s[mine], side="right") - 1
            row[mine] = begin + np.maximum(found, 0)
        x = ((time_s - self.start_s[row]) / self.length_s[row])[:, None]
        position = self.coefficients[-1].take(row, axis=0)
        slope = np.zeros((len(row), 3))
        for nodes, coefficients in zip(self.nodes[-2::-1], self.coefficients[-2::-1], strict=True):
            offset = x - nodes.take(row)[:, None]
            slope = slope * offset + position
            position = position * offset + coefficients.take(row, axis=0)
        return position, slope / self.length_s[row, None]


def interpolant(tables: Sequence[StateTable]) -> Interpolant:
    """Return the polynomials of tables."""
    parts = [_intervals(table) for table in tables]
    first = np.cumsum([0, *(len(part[0]) for part in parts)])
    start, length = (np.concatenate([part[k] for part in parts]) for k in (0, 1))
    # Contiguous, for `take` copies the whole of what is not.
    nodes, coefficients = (
        np.ascontiguousarray(np.concatenate([part[k] for part in parts], axis=1)) for k in (2, 3)
    )
    return Interpolant(first, start, length, nodes, coefficients)


def largest_doubt_m(table: StateTable) -> float | None:
    """Return the largest distance between a state's position and what the states about it give
    without it.

    Between states the error is smaller still, by far where the motion is smooth. None where no
    stretch has three.
    """
    doubts = []
    for rows in runs(table):
        for parity in (0, 1):
            is_kept = np.arange(len(rows)) % 2 == parity
            is_kept[[0, -1]] = True
            kept = rows[is_kept]
            left_out = rows[~is_kept]
            if len(kept) >= 2 and left_out.size:
                coarse = interpolant([_thinned(table, kept)])
                guess, _ = coarse.state(np.zeros(len(left_out), np.intp), table.time_s[left_out])
                doubts.append(
                    np.sqrt(((guess - table.position_m[left_out]) ** 2).sum(axis=1)).max()
                )
    return float(max(doubts)) if doubts else None


def _thinned(table: StateTable, rows: RowArray) -> StateTable:
    velocity = None if table.velocity_m_s is None else table.velocity_m_s[rows]
    return StateTable(
        table.time_s[rows],
        table.position_m[rows],
        velocity,
        np.zeros(len(rows), np.intp),
        table.burns_s,
    )


def _intervals(table: StateTable) -> tuple[FloatArray, FloatArray, FloatArray, FloatArray]:
    """Return the intervals of a table: starts and lengths (m,), nodes (8, m) and coefficients (8,
    m, 3).
    """
    parts = [_of_run(table, rows) for rows in runs(table)]
    parts = [part for part in parts if len(part[0])]
    start, length = (np.concatenate([part[k] for part in parts]) for k in (0, 1))
    nodes, coefficients = (np.concatenate([part[k] for part in parts], axis=1) for k in (2, 3))
    return start, length, nodes, coefficients


def runs(table: StateTable) -> list[RowArray]:
    """Return the rows of each run."""
    return np.split(np.arange(len(table.run)), np.flatnonzero(np.diff(table.run)) + 1)


def _of_run(
    table: StateTable, rows: RowArray
) -> tuple[FloatArray, FloatArray, FloatArray, FloatArray]:
    has_velocity = table.velocity_m_s is not None
    count = min(len(rows), _WITH_VELOCITY if has_velocity else _WITHOUT_VELOCITY)
    left = np.arange(len(rows) - 1)
    window = np.clip(left - (count // 2 - 1), 0, max(len(rows) - count, 0))
    chosen = rows[window[:, None] + np.arange(count)]
    start = table.time_s[rows[:-1]]
    length = table.time_s[rows[1:]] - start
    nodes, coefficients = _newton(table, chosen, start, length)
    if has_velocity and count > 2:
        uneven = np.flatnonzero(np.diff(table.time_s[chosen], axis=1).min(axis=1) < _EVEN * length)
        ends = rows[uneven[:, None] + np.arange(2)]
        nodes[:, uneven], coefficients[:, uneven] = _newton(
            table, ends, start[uneven], length[uneven]
        )
    return start, length, nodes, coefficients


def _newton(
    table: StateTable, chosen: RowArray, start: FloatArray, length: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Return nodes (8, m) and coefficients (8, m, 3) of polynomials through the states `chosen` (m,
    k), each.
    """
    repeats = 1 if table.velocity_m_s is None else 2
    nodes = np.repeat((table.time_s[chosen] - start[:, None]) / length[:, None], repeats, axis=1).T
    values = np.repeat(table.position_m[chosen], repeats, axis=1).transpose(1, 0, 2)
    slopes = None
    if table.velocity_m_s is not None:
        slopes = table.velocity_m_s[chosen].transpose(1, 0, 2) * length[None, :, None]
    coefficients = _divided_differences(nodes, values, slopes)
    lacking = _TERMS - len(nodes)
    return np.pad(nodes, ((0, lacking), (0, 0))), np.pad(
        coefficients, ((0, lacking), (0, 0), (0, 0))
    )


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
