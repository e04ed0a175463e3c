"""Tables of states as CSV: a line of column names with units, then one state per line, in ECEF."""

import csv
import io
import math
from collections.abc import Iterator
from itertools import chain, islice

import numpy as np

from opir_core.arrays import FloatArray
from opir_readers.table import MOST_BURNS, BadTableError, Table, require_order, require_places

#: The most points where the motion is not smooth: each costs as much as a hundred states.
MOST_BREAKS = 10_000

_PLACE = ("time_s", "x_ecef_m", "y_ecef_m", "z_ecef_m")
_VELOCITY = ("vx_ecef_m_s", "vy_ecef_m_s", "vz_ecef_m_s")
_BURNING = "is_burning"
_KNOWN = (*_PLACE, *_VELOCITY, _BURNING)


def csv_table(text: str, start_s: float) -> Table:
    """Return the table of a CSV file whose time 0 is the scene time `start_s`.

    Columns, in any order: time_s, x_ecef_m, y_ecef_m, z_ecef_m; perhaps vx_ecef_m_s, vy_ecef_m_s, vz_ecef_m_s
    (relative to the rotating Earth), and is_burning: 1 where the plume radiates from this line's time to the next, else
    0. Lines that begin with # are comments. A time that occurs twice in a row marks a point where the motion is not
    smooth, as a change of stages. Raises `BadTableError`.
    """
    columns = _columns(text)
    count = len(columns["time_s"])
    if count < 2:
        raise BadTableError(f"has {count} state{'s' if count != 1 else ''}; at least 2 are needed")
    time_s = columns["time_s"] + start_s

    def line_of(row: int) -> int:
        return next(islice(_lines(text)[1], row, None))[0]

    require_order(time_s, line_of, may_repeat=True)
    position = np.stack([columns[name] for name in _PLACE[1:]], axis=1)
    require_places(position, line_of)
    velocity = np.stack([columns[name] for name in _VELOCITY], axis=1) if _VELOCITY[0] in columns else None
    run = np.cumsum(np.diff(time_s, prepend=time_s[0] - 1.0) == 0.0)
    if run[-1] > MOST_BREAKS:
        raise BadTableError(f"has {run[-1]} times that occur twice; at most {MOST_BREAKS} points can be not smooth")
    return Table(time_s, position, velocity, run, _burns_s(time_s, columns.get(_BURNING, np.ones(count))))


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


def _columns(text: str) -> dict[str, FloatArray]:
    """Return the columns by name: read at once where all are plain numbers, else line by line, to say what is not."""
    names, lines = _lines(text)
    values = _plain_numbers(text, len(names))
    if values is not None and _BURNING in names:
        burning = values[:, names.index(_BURNING)]
        values = values if ((burning == 0.0) | (burning == 1.0)).all() else None
    if values is None:
        values = np.array([_row(names, cells, line) for line, cells in lines]).reshape(-1, len(names))
    return dict(zip(names, values.T, strict=True))


def _plain_numbers(text: str, count: int) -> FloatArray | None:
    """Return the numbers (n, count) under the line of names, or None where something else stands there."""
    plain = (line for line in io.StringIO(text) if not line.isspace() and not line.lstrip().startswith("#"))
    if next(plain, None) is None or (first := next(plain, None)) is None:
        return None
    try:
        values = np.loadtxt(chain([first], plain), delimiter=",", comments=None, quotechar='"', ndmin=2)
    except ValueError:
        return None
    return values if values.shape[1] == count and np.isfinite(values).all() else None


def _lines(text: str) -> tuple[list[str], Iterator[tuple[int, list[str]]]]:
    """Return the names of the columns, and an iterator over the cells of the lines under them, with their numbers."""
    lines = _numbered(text)
    line, names = next(lines, (0, []))
    if not names:
        raise BadTableError(f"is empty; its first line names the columns: {', '.join(_PLACE)}")
    names = [name.strip() for name in names]
    _require_columns(names, line)
    return names, lines


def _numbered(text: str) -> Iterator[tuple[int, list[str]]]:
    """Yield the cells of each line that is neither empty nor a comment, with its number."""
    reader = csv.reader(io.StringIO(text), strict=True)
    try:
        for cells in reader:
            if cells and not cells[0].lstrip().startswith("#"):
                yield reader.line_num, cells
    except csv.Error as error:
        raise BadTableError(f"line {reader.line_num}: not CSV: {error}") from error


def _require_columns(names: list[str], line: int) -> None:
    has_velocity = any(name in names for name in _VELOCITY)
    missing = [name for name in (*_PLACE, *(_VELOCITY if has_velocity else ())) if name not in names]
    unknown = [name for name in names if name not in _KNOWN]
    if missing or unknown or len(set(names)) < len(names):
        reasons = [f"lacks the column{'s' if missing[1:] else ''} {', '.join(missing)}"] if missing else []
        reasons += [f"has unknown columns ({', '.join(map(repr, unknown[:4]))})"] if unknown else []
        reasons = reasons or ["names a column twice"]
        raise BadTableError(f"line {line}: {' and '.join(reasons)}; known are {', '.join(_KNOWN)}")


def _row(names: list[str], cells: list[str], line: int) -> list[float]:
    if len(cells) != len(names):
        raise BadTableError(f"line {line}: has {len(cells)} values; the first line names {len(names)} columns")
    return [_number(name, cell, line) for name, cell in zip(names, cells, strict=True)]


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
