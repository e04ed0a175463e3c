"""Tables whose columns have names like `Altitude (ft)`: quantities and units of the programs that
write them.
"""

import math
import re
from collections.abc import Iterator, Mapping, Sequence

import numpy as np
from attrs import frozen

from opir_core.arrays import FloatArray
from opir_core.plugin import BadFileError
from opir_readers.csv_layout import Layout, decimal, layout_of

#: Units as programs write them, in SI units and radians; "" is none.
_TIMES = {"s": 1.0, "sec": 1.0, "ms": 1e-3, "min": 60.0, "h": 3600.0}
_LENGTHS = {
    "m": 1.0,
    "cm": 0.01,
    "mm": 1e-3,
    "km": 1e3,
    "ft": 0.3048,
    "in": 0.0254,
    "yd": 0.9144,
    "mi": 1609.344,
}
_SPEEDS = {
    "m/s": 1.0,
    "km/h": 1.0 / 3.6,
    "ft/s": 0.3048,
    "ft/sec": 0.3048,
    "mph": 0.44704,
    "kt": 1852.0 / 3600.0,
}
_ANGLES = {"°": math.pi / 180.0, "deg": math.pi / 180.0, "rad": 1.0}
_FORCES = {"n": 1.0, "lb": 4.4482216152605, "lbf": 4.4482216152605, "kgf": 9.80665, "kn": 1e3}
UNITS: Mapping[str, float] = (
    {"": 1.0, "nmi": 1852.0} | _TIMES | _LENGTHS | _SPEEDS | _ANGLES | _FORCES
)

_NAME = re.compile(r"\s*(.*?)\s*(?:[(\[]\s*([^)\]]*?)\s*[)\]])?\s*")


@frozen(eq=False)
class NamedColumns:
    """The columns (n,) that were asked for, by quantity, in SI units, nan for what is no number;
    and their lines.
    """

    values: Mapping[str, FloatArray]
    lines: Sequence[int]

    def line_of(self, row: int) -> int:
        """Return the line of a row."""
        return self.lines[row]


def split_name(name: str) -> tuple[str, str]:
    """Return a column's name in lower case and its unit.

    >>> split_name("Altitude (ft)")
    ('altitude', 'ft')
    """
    match = _NAME.fullmatch(name)
    return (match[1].lower(), (match[2] or "").lower()) if match else (name.lower(), "")


def names_of_head(text: str, lines: int = 60) -> list[set[str]]:
    """Return, for each of the first lines, the names in it without units, in lower case."""
    found = []
    for line in text.split("\n", lines)[:lines]:
        bare = line.lstrip("\ufeff#% ").strip()
        found.append({split_name(name.strip().strip('"'))[0] for name in re.split("[,;\t]", bare)})
    return found


def named_columns(text: str, wanted: Mapping[str, Sequence[str]]) -> NamedColumns:
    """Return columns of a table; `wanted` gives, by quantity, the names in lower case that it may
    have.

    Raises `BadFileError` where a unit is not known, or a table has no lines.
    """
    layout = layout_of(text)
    places: dict[str, tuple[int, float]] = {}
    for place, name in enumerate(layout.names):
        bare, unit = split_name(name)
        quantity = next((own for own, names in wanted.items() if bare in names), None)
        if quantity is None or quantity in places:
            continue
        if unit not in UNITS:
            raise BadFileError(
                f"line {layout.line}: {name!r} has the unit {unit!r}; known are"
                f" {', '.join(filter(None, UNITS))}"
            )
        places[quantity] = place, UNITS[unit]
    if not places:
        raise BadFileError(
            f"line {layout.line}: names no column that is read:"
            f" {', '.join(map(repr, layout.names[:12]))}"
        )
    rows = list(_rows(layout, text, places))
    if len(rows) < 2:
        raise BadFileError(f"has {len(rows)} states; at least 2 are needed")
    values = np.array([row for _, row in rows]).reshape(-1, len(places))
    with np.errstate(over="ignore"):
        columns = {
            quantity: values[:, number] * factor
            for number, (quantity, (_, factor)) in enumerate(places.items())
        }
    return NamedColumns(columns, [line for line, _ in rows])


def _rows(
    layout: Layout, text: str, places: Mapping[str, tuple[int, float]]
) -> Iterator[tuple[int, list[float]]]:
    for line, cells in layout.rows(text):
        if len(cells) < len(layout.names):
            raise BadFileError(
                f"line {line}: has {len(cells)} values; line {layout.line} names"
                f" {len(layout.names)} columns"
            )
        yield line, [_number(cells[place], layout) for place, _ in places.values()]


def _number(cell: str, layout: Layout) -> float:
    try:
        value = decimal(cell, layout)
    except ValueError:
        return math.nan
    return value if math.isfinite(value) else math.nan
