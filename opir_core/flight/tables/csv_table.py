"""Tables of states as CSV: a line of column names with units, then one state per line, in ECEF."""

import csv
import io
import math
from collections.abc import Iterator

import numpy as np

from opir_core.flight.tables.table import BadTableError, Table, require_order, require_places

_PLACE = ("time_s", "x_ecef_m", "y_ecef_m", "z_ecef_m")
_VELOCITY = ("vx_ecef_m_s", "vy_ecef_m_s", "vz_ecef_m_s")
_BURNING = "is_burning"
_KNOWN = (*_PLACE, *_VELOCITY, _BURNING)

Row = dict[str, float]


def csv_table(text: str, start_s: float) -> Table:
    """Return the table of a CSV file whose time 0 is the scene time `start_s`.

    Columns, in any order: time_s, x_ecef_m, y_ecef_m, z_ecef_m; perhaps vx_ecef_m_s, vy_ecef_m_s, vz_ecef_m_s
    (relative to the rotating Earth), and is_burning (0 or 1). Lines that begin with # are comments. A time that occurs
    twice in a row marks a point where the motion is not smooth. Raises `BadTableError`.
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
    burning = np.flatnonzero(columns.get(_BURNING, np.ones(len(rows))))
    if not burning.size:
        raise BadTableError(f"{_BURNING} is 0 throughout; it says where the plume radiates")
    return Table(time_s, position, velocity, run, (float(time_s[burning[0]]), float(time_s[burning[-1]])))


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
