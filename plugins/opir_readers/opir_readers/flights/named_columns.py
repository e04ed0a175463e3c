"""Tables whose columns have names like `Altitude (ft)`: quantities and units of the programs that
write them.
"""

import math
import re
from collections.abc import Iterator, Mapping, Sequence

import numpy as np
from attrs import frozen

from opir_core.arrays import FloatArray, RowArray
from opir_core.plugin import BadFileError
from opir_readers.columns import Units, bare_name
from opir_readers.csv_layout import Layout, layout_of
from opir_readers.published import published
from opir_readers.states import number_or_nan

#: Units as programs write them, in SI units and radians; "" is none.
UNITS: Units = published("units")["rocket simulators"]


@frozen(eq=False)
class NamedColumns:
    """Columns (n,) by quantity, in SI units, nan for what is no number; and their lines."""

    values: Mapping[str, FloatArray]
    lines: Sequence[int]

    def line_of(self, row: int) -> int:
        """Return the line of a row."""
        return self.lines[row]

    def taken(self, rows: RowArray) -> "NamedColumns":
        """Return some of the rows; raises `BadFileError` for fewer than 2."""
        if len(rows) < 2:
            raise BadFileError(f"has {len(rows)} states; at least 2 are needed")
        values = {name: column[rows] for name, column in self.values.items()}
        return NamedColumns(values, [self.lines[row] for row in rows.tolist()])


def names_of_head(text: str, lines: int = 60) -> list[set[str]]:
    """Return, for each of the first lines, the names in it without units, in lower case."""
    heads = [line.lstrip("\ufeff#% ").strip() for line in text.split("\n", lines)[:lines]]
    return [
        {bare_name(name.strip().strip('"'))[0] for name in re.split("[,;\t]", head)}
        for head in heads
    ]


def named_columns(text: str, names_of: Mapping[str, Sequence[str]]) -> NamedColumns:
    """Return columns of a table; `names_of` gives, by quantity, the names in lower case that it may
    have.

    Raises `BadFileError` where a unit is not known, or a table has no lines.
    """
    layout = layout_of(text)
    places: dict[str, tuple[int, float]] = {}
    for place, name in enumerate(layout.names):
        bare, unit = bare_name(name)
        quantity = next((key for key, names in names_of.items() if bare in names), None)
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
    rows = list(_rows(layout, text))
    with np.errstate(over="ignore"):
        values = {
            quantity: factor * np.array([_number(cells[place], layout) for _, cells in rows])
            for quantity, (place, factor) in places.items()
        }
    return NamedColumns(values, [line for line, _ in rows]).taken(np.arange(len(rows)))


def _rows(layout: Layout, text: str) -> Iterator[tuple[int, list[str]]]:
    for line, cells in layout.rows(text):
        if len(cells) < len(layout.names):
            raise BadFileError(
                f"line {line}: has {len(cells)} values; line {layout.line} names"
                f" {len(layout.names)} columns"
            )
        yield line, cells


def _number(cell: str, layout: Layout) -> float:
    try:
        return number_or_nan(layout.number(cell))
    except ValueError:
        return math.nan
