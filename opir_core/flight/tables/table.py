"""Tables of states, their checks, and local polynomials through them in Newton's form, for many tables at once.

Between two states the polynomial is that through the nearest states: four with their velocities (degree 7), or six
positions alone (degree 5); fewer where a smooth run has fewer. It never extends across the end of a run.
"""

from collections.abc import Sequence

import numpy as np
from attrs import frozen
from numpy.typing import NDArray

from opir_core.arrays import FloatArray, RowArray

#: Positions nearer to the Earth's centre, or farther from it, m, are most likely in other units.
LEAST_RADIUS_M, MOST_RADIUS_M = 6.2e6, 1e9


class BadTableError(ValueError):
    """An invalid table; the only argument is the reason, with its line and the remedy."""


@frozen(eq=False)
class Table:
    """States in order of time: scene times (n,), s, ECEF positions (n, 3), m, and velocities over the Earth, m/s.

    `velocity_m_s` is None where the file has none. `run` (n,) numbers the runs of smooth motion, which polynomials do
    not cross. `burn_s` is the interval of the burn.
    """

    time_s: FloatArray
    position_m: FloatArray
    velocity_m_s: FloatArray | None
    run: NDArray[np.intp]
    burn_s: tuple[float, float]


def require_order(time_s: FloatArray, lines: list[int], *, may_repeat: bool) -> None:
    """Raise `BadTableError` where times do not increase; with `may_repeat` a time may occur twice in a row."""
    step = np.diff(time_s)
    wrong = np.flatnonzero(step < 0.0 if may_repeat else step <= 0.0)
    thrice = np.flatnonzero((step[1:] == 0.0) & (step[:-1] == 0.0)) + 1 if may_repeat else wrong[:0]
    for row in [*wrong.tolist(), *thrice.tolist()]:
        raise BadTableError(
            f"line {lines[row + 1]}: its time does not follow that of line {lines[row]}; sort the states"
        )


def require_places(position_m: FloatArray, lines: list[int]) -> None:
    """Raise `BadTableError` for a position deep inside the Earth or beyond the Moon."""
    with np.errstate(over="ignore"):
        radius_m = np.sqrt((position_m * position_m).sum(axis=1))
    for row in np.flatnonzero((radius_m < LEAST_RADIUS_M) | (radius_m > MOST_RADIUS_M)).tolist():
        where = "deep below the ground" if radius_m[row] < LEAST_RADIUS_M else "beyond the Moon"
        place = f"{radius_m[row]:.6g} m from the Earth's centre, {where}"
        raise BadTableError(f"line {lines[row]}: the position is {place}; check its units")


_WITH_VELOCITY = 4
_WITHOUT_VELOCITY = 6

#: Coefficients of Newton's form, for all intervals.
_TERMS = 2 * _WITH_VELOCITY


@frozen(eq=False)
class Interpolant:
    """Polynomials over the intervals (m,) of n tables: table by table, in order of time.

    `first` (n + 1,) is where each table's intervals begin, `start_s` (m,) and `length_s` (m,) are the intervals,
    `nodes` (8, m) and `coefficients` (8, m, 3) Newton's form in time since the start, in lengths.
    """

    first: RowArray
    start_s: FloatArray
    length_s: FloatArray
    nodes: FloatArray
    coefficients: FloatArray

    def state(self, table: RowArray, time_s: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return positions and velocities (k, 3) of tables (k,) at times (k,) within them."""
        row = np.empty(len(table), dtype=np.intp)
        for number in np.unique(table).tolist():
            begin, end = self.first[number], self.first[number + 1]
            mine = table == number
            found = np.searchsorted(self.start_s[begin:end], time_s[mine], side="right") - 1
            row[mine] = begin + np.maximum(found, 0)
        x = ((time_s - self.start_s[row]) / self.length_s[row])[:, None]
        position, slope = self.coefficients[-1, row], np.zeros((len(row), 3))
        for nodes, coefficients in zip(self.nodes[-2::-1], self.coefficients[-2::-1], strict=True):
            offset = x - nodes[row, None]
            slope = slope * offset + position
            position = position * offset + coefficients[row]
        return position, slope / self.length_s[row, None]


def interpolant(tables: Sequence[Table]) -> Interpolant:
    """Return the polynomials of tables."""
    parts = [_intervals(table) for table in tables]
    first = np.cumsum([0, *(len(part[0]) for part in parts)])
    start, length = (np.concatenate([part[k] for part in parts]) for k in (0, 1))
    nodes, coefficients = (np.concatenate([part[k] for part in parts], axis=1) for k in (2, 3))
    return Interpolant(first, start, length, nodes, coefficients)


def largest_doubt_m(table: Table) -> float | None:
    """Return the largest distance between a state's position and what the states about it give without it.

    Between states the error is smaller still, by far where the motion is smooth. None where no stretch has three.
    """
    doubts = []
    for run in range(int(table.run[-1]) + 1):
        rows = np.flatnonzero(table.run == run)
        for parity in (0, 1):
            kept = np.union1d(rows[parity::2], rows[[0, -1]])
            left_out = np.setdiff1d(rows, kept)
            if len(kept) >= 2 and left_out.size:
                coarse = interpolant([_thinned(table, kept)])
                guess, _ = coarse.state(np.zeros(len(left_out), np.intp), table.time_s[left_out])
                doubts.append(np.sqrt(((guess - table.position_m[left_out]) ** 2).sum(axis=1)).max())
    return float(max(doubts)) if doubts else None


def _thinned(table: Table, rows: RowArray) -> Table:
    velocity = None if table.velocity_m_s is None else table.velocity_m_s[rows]
    return Table(table.time_s[rows], table.position_m[rows], velocity, np.zeros(len(rows), np.intp), table.burn_s)


def _intervals(table: Table) -> tuple[FloatArray, FloatArray, FloatArray, FloatArray]:
    """Return the intervals of a table: starts and lengths (m,), nodes (8, m) and coefficients (8, m, 3)."""
    parts = [_of_run(table, np.flatnonzero(table.run == run)) for run in range(int(table.run[-1]) + 1)]
    parts = [part for part in parts if len(part[0])]
    start, length = (np.concatenate([part[k] for part in parts]) for k in (0, 1))
    nodes, coefficients = (np.concatenate([part[k] for part in parts], axis=1) for k in (2, 3))
    return start, length, nodes, coefficients


def _of_run(table: Table, rows: RowArray) -> tuple[FloatArray, FloatArray, FloatArray, FloatArray]:
    has_velocity = table.velocity_m_s is not None
    count = min(len(rows), _WITH_VELOCITY if has_velocity else _WITHOUT_VELOCITY)
    left = np.arange(len(rows) - 1)
    window = np.clip(left - (count // 2 - 1), 0, max(len(rows) - count, 0))
    chosen = rows[window[:, None] + np.arange(count)]
    start = table.time_s[rows[:-1]]
    length = table.time_s[rows[1:]] - start
    repeats = 2 if has_velocity else 1
    nodes = np.repeat((table.time_s[chosen] - start[:, None]) / length[:, None], repeats, axis=1).T
    values = np.repeat(table.position_m[chosen], repeats, axis=1).transpose(1, 0, 2)
    slopes = None
    if table.velocity_m_s is not None:
        slopes = table.velocity_m_s[chosen].transpose(1, 0, 2) * length[None, :, None]
    coefficients = _divided_differences(nodes, values, slopes)
    lacking = _TERMS - len(nodes)
    padded_nodes = np.concatenate([nodes, np.zeros((lacking, len(start)))])
    return start, length, padded_nodes, np.concatenate([coefficients, np.zeros((lacking, len(start), 3))])


def _divided_differences(nodes: FloatArray, values: FloatArray, slopes: FloatArray | None) -> FloatArray:
    """Return Newton's coefficients (k, m, 3); where nodes come in pairs, a pair's first difference is the slope."""
    coefficients, column = [values[0]], values
    for order in range(1, len(nodes)):
        gap = (nodes[order:] - nodes[:-order])[..., None]
        difference = column[1:] - column[:-1]
        if order == 1 and slopes is not None:
            gap[::2] = 1.0
            difference[::2] = slopes
        column = difference / gap
        coefficients.append(column[0])
    return np.stack(coefficients)
