"""Numbers and texts out of rows of files, with the row that is to blame."""

import math
from collections.abc import Mapping, Sequence
from typing import Any

from opir_core.plugin import BadFileError


def place_of(row: Mapping[str, Any]) -> str:
    """Return the beginning of a message about a row: its line, where the reader gave it."""
    return f"line {row['line']}: " if "line" in row else ""


def number_of_row(row: Mapping[str, Any], name: str) -> float:
    """Return the finite number of a key; raises `BadFileError`."""
    return finite(row.get(name), f"{place_of(row)}{name}")


def finite(value: Any, what: str) -> float:
    """Return a value as a finite number; raises `BadFileError` with `what` it is."""
    try:
        number = math.nan if isinstance(value, bool) else float(value)
    except (TypeError, ValueError, OverflowError):
        number = math.nan
    if not math.isfinite(number):
        raise BadFileError(f"{what} is {shown(value)}, not a finite number")
    return number


def vector_of_row(row: Mapping[str, Any], name: str) -> tuple[float, ...]:
    """Return the three finite numbers of a key; raises `BadFileError`."""
    value = row.get(name)
    if not isinstance(value, Sequence) or isinstance(value, str) or len(value) != 3:
        raise BadFileError(f"{place_of(row)}{name} is {shown(value)}, not three numbers")
    return tuple(finite(each, f"{place_of(row)}{name}") for each in value)


def shown(value: Any) -> str:
    """Return a value for a message, cut short."""
    text = repr(value)
    return text if len(text) <= 60 else f"{text[:57]}..."
