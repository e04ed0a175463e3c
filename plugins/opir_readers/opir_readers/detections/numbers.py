"""Numbers and texts out of rows of files, with the row that is to blame."""

import math
from collections.abc import Mapping, Sequence
from typing import Any

from opir_core.plugin import BadFileError
from opir_readers.states import number_or_nan

#: The key of what a user should know of a file, in its first row.
NOTES = "notes"

#: A detection by the keys of an event, and with its line, if the reader gives it.
Row = Mapping[str, Any]
Rows = Sequence[Row]


def place_of(row: Row) -> str:
    """Return the beginning of a message about a row: its line, if the reader gave it."""
    return f"line {row['line']}: " if "line" in row else ""


def number_of_row(row: Row, name: str) -> float:
    """Return the finite number of a key; raises `BadFileError`."""
    return finite(row.get(name), f"{place_of(row)}{name}")


def finite(value: Any, subject: str) -> float:
    """Return a value as a finite number; raises `BadFileError`, whose message begins with the
    subject.
    """
    if type(value) is float and math.isfinite(value):
        return value
    number = math.nan if isinstance(value, bool) else number_or_nan(value)
    if math.isnan(number):
        raise BadFileError(f"{subject} is {shown(value)}, not a finite number")
    return number


def vector_of_row(row: Row, name: str) -> list[float]:
    """Return the three finite numbers of a key; raises `BadFileError`."""
    value = row.get(name)
    if not isinstance(value, Sequence) or isinstance(value, str) or len(value) != 3:
        raise BadFileError(f"{place_of(row)}{name} is {shown(value)}, not three numbers")
    return [finite(component, f"{place_of(row)}{name}") for component in value]


def shown(value: Any) -> str:
    """Return a value for a message, cut short."""
    text = repr(value)
    return text if len(text) <= 60 else f"{text[:57]}..."
