"""Tables of states, their checks, and local polynomials through them in Newton's form, for many tables at once.

Between two states the polynomial is that through the nearest states: four with their velocities (degree 7), or six
positions alone (degree 5); fewer where a smooth run has fewer. With velocities, the two ends alone (degree 3) where
states are much closer to each other than these. It never extends across the end of a run.

A table as CSV has a line of column names with units, then one state per line, in ECEF.
"""

import csv
import io
import math
from collections.abc import Iterator, Sequence

import numpy as np
from attrs import frozen
from numpy.typing import NDArray

from opir_core.arrays import FloatArray, RowArray

#: Positions nearer to the Earth's centre, or farther from it, m, are most likely in other units.
LEAST_RADIUS_M, MOST_RADIUS_M = 6.2e6, 1e9


#: The most burns of a flight, as many as plumes have stages.
MOST_BURNS = 8


class BadTableError(ValueError):
    """An invalid table; the only argument is the reason, with its line and the remedy."""


@frozen(eq=False)
class Table:
    """States in order of time: scene times (n,), s, ECEF positions (n, 3), m, and velocities over the Earth, m/s.

    `velocity_m_s` is None where the file has none. `run` (n,) numbers the runs of smooth motion, which polynomials do
    not cross. `burns_s` (k, 2) are the scene times of ignition and burnout of each burn, in order.
    """

    time_s: FloatArray
    position_m: FloatArray
    velocity_m_s: FloatArray | None
    run: NDArray[np.intp]
    burns_s: FloatArray


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

#: States nearer to each other than this share of an interval amplify the rounding of times and positions.
_EVEN = 0.125

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
    return Table(table.time_s[rows], table.position_m[rows], velocity, np.zeros(len(rows), np.intp), table.burns_s)


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
    nodes, coefficients = _newton(table, chosen, start, length)
    if has_velocity and count > 2:
        uneven = np.flatnonzero(np.diff(table.time_s[chosen], axis=1).min(axis=1) < _EVEN * length)
        ends = rows[uneven[:, None] + np.arange(2)]
        nodes[:, uneven], coefficients[:, uneven] = _newton(table, ends, start[uneven], length[uneven])
    return start, length, nodes, coefficients


def _newton(table: Table, chosen: RowArray, start: FloatArray, length: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return nodes (8, m) and coefficients (8, m, 3) of polynomials through the states `chosen` (m, k), each."""
    repeats = 1 if table.velocity_m_s is None else 2
    nodes = np.repeat((table.time_s[chosen] - start[:, None]) / length[:, None], repeats, axis=1).T
    values = np.repeat(table.position_m[chosen], repeats, axis=1).transpose(1, 0, 2)
    slopes = None
    if table.velocity_m_s is not None:
        slopes = table.velocity_m_s[chosen].transpose(1, 0, 2) * length[None, :, None]
    coefficients = _divided_differences(nodes, values, slopes)
    lacking = _TERMS - len(nodes)
    return np.pad(nodes, ((0, lacking), (0, 0))), np.pad(coefficients, ((0, lacking), (0, 0), (0, 0)))


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


_PLACE = ("time_s", "x_ecef_m", "y_ecef_m", "z_ecef_m")
_VELOCITY = ("vx_ecef_m_s", "vy_ecef_m_s", "vz_ecef_m_s")
_BURNING = "is_burning"
_KNOWN = (*_PLACE, *_VELOCITY, _BURNING)

Row = dict[str, float]


def csv_table(text: str, start_s: float) -> Table:
    """Return the table of a CSV file whose time 0 is the scene time `start_s`.

    Columns, in any order: time_s, x_ecef_m, y_ecef_m, z_ecef_m; perhaps vx_ecef_m_s, vy_ecef_m_s, vz_ecef_m_s
    (relative to the rotating Earth), and is_burning: 1 where the plume radiates from this line's time to the next, else
    0. Lines that begin with # are comments. A time that occurs twice in a row marks a point where the motion is not
    smooth, as a change of stages. Raises `BadTableError`.
    """
    lines, rows = list[int](), list[Row]()
    for line, row in _rows(text):
        lines.append(line)
        rows.append(row)
    if len(rows) < 2:
        raise BadTableError(f"has {len(rows)} state{'s' if len(rows) != 1 else ''}; at least 2 are needed")
    columns = {name: np.array([row[name] for row in rows]) for name in rows[0]}
    time_s = columns["time_s"] + start_s
    require_order(time_s, lines, may_repeat=True)
    position = np.stack([columns[name] for name in _PLACE[1:]], axis=1)
    require_places(position, lines)
    velocity = np.stack([columns[name] for name in _VELOCITY], axis=1) if _VELOCITY[0] in columns else None
    run = np.cumsum(np.diff(time_s, prepend=time_s[0] - 1.0) == 0.0)
    return Table(time_s, position, velocity, run, _burns_s(time_s, columns.get(_BURNING, np.ones(len(rows)))))


def _burns_s(time_s: FloatArray, is_burning: FloatArray) -> FloatArray:
    """Return the burns (k, 2) of states at times (n,): each from a line with 1 to the next line with 0, or the last."""
    edge = np.diff(np.concatenate([[0.0], is_burning[:-1], [0.0]]))
    burns_s = np.stack([time_s[edge > 0.0], time_s[edge < 0.0]], axis=-1)
    # A time that occurs twice may end one burn and begin the next, or hold a burn of no length.
    burns_s = burns_s[burns_s[:, 0] < burns_s[:, 1]]
    if not len(burns_s):
        raise BadTableError(f"{_BURNING} is 0 throughout; 1 says that the plume radiates up to the next line's time")
    if len(burns_s) > MOST_BURNS:
        raise BadTableError(f"{_BURNING} begins {len(burns_s)} burns; at most {MOST_BURNS} are possible")
    return burns_s


def _rows(text: str) -> Iterator[tuple[int, Row]]:
    reader = csv.reader(io.StringIO(text), strict=True)
    names: list[str] | None = None
    try:
        for cells in reader:
            if not cells or cells[0].lstrip().startswith("#"):
                continue
            if names is None:
                names = [cell.strip() for cell in cells]
                _require_columns(names, reader.line_num)
            else:
                yield reader.line_num, _row(names, cells, reader.line_num)
    except csv.Error as error:
        raise BadTableError(f"line {reader.line_num}: not CSV: {error}") from error
    if names is None:
        raise BadTableError(f"is empty; its first line names the columns: {', '.join(_PLACE)}")


def _require_columns(names: list[str], line: int) -> None:
    has_velocity = any(name in names for name in _VELOCITY)
    missing = [name for name in (*_PLACE, *(_VELOCITY if has_velocity else ())) if name not in names]
    unknown = [name for name in names if name not in _KNOWN]
    if missing or unknown or len(set(names)) < len(names):
        reasons = [f"lacks the column{'s' if missing[1:] else ''} {', '.join(missing)}"] if missing else []
        reasons += [f"has unknown columns ({', '.join(map(repr, unknown[:4]))})"] if unknown else []
        reasons = reasons or ["names a column twice"]
        raise BadTableError(f"line {line}: {' and '.join(reasons)}; known are {', '.join(_KNOWN)}")


def _row(names: list[str], cells: list[str], line: int) -> Row:
    if len(cells) != len(names):
        raise BadTableError(f"line {line}: has {len(cells)} values; the first line names {len(names)} columns")
    return {name: _number(name, cell, line) for name, cell in zip(names, cells, strict=True)}


def _number(name: str, cell: str, line: int) -> float:
    try:
        value = float(cell)
    except ValueError:
        value = math.nan
    if not math.isfinite(value) or "_" in cell:
        raise BadTableError(f"line {line}: {name} is {cell.strip()!r}, not a finite number")
    if name == _BURNING and value not in (0.0, 1.0):
        raise BadTableError(f"line {line}: {name} is {cell.strip()!r}; 0 or 1 is needed")
    return value
