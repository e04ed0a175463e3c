"""JSON as the text of a table: names of columns in its first line, then a line for each record."""

import csv
import io
import json
from collections import Counter
from collections.abc import Iterable, Iterator, Mapping, Sequence
from typing import Any

#: Lists in a record that are longer than this are no vectors.
_LONGEST_VECTOR = 9
#: A name that fewer than one in so many records have is no column: a table of records that all have
#: other names would be as large as their square.
_RAREST = 100

Records = Sequence[Mapping[str, Any]]


def table_of_json(text: str) -> str | None:
    """Return the records of JSON as comma-separated text, None if it is not a table.

    A table is a list of records, records a line each, lists by name, or an object with one of these
    among its values. Values inside of a record have names like `position.x` and `position.0`. Names
    of few records are left out.
    """
    records = _records(_value(text)) if text.lstrip()[:1] in ("{", "[") else []
    rows = [dict(_flattened(record, "")) for record in records]
    times = Counter(name for row in rows for name in row)
    names = [name for name, count in times.items() if count * _RAREST >= len(rows)]
    has_numbers = (any(isinstance(cell, int | float) for cell in row.values()) for row in rows)
    if not names or sum(has_numbers) < 2:
        return None
    table = io.StringIO()
    writer = csv.DictWriter(table, names, "", extrasaction="ignore", lineterminator="\n")
    writer.writeheader()
    writer.writerows(rows)
    return table.getvalue()


def _value(text: str) -> Any:
    """Return the value of JSON, of several lines of it the list of their values, None for other
    text.
    """
    try:
        return json.loads(text)
    except (ValueError, RecursionError):
        pass
    try:
        return [json.loads(line) for line in text.split("\n") if line.strip()]
    except (ValueError, RecursionError):
        return None


def _records(value: Any) -> Records:
    """Return the records of a value or, of an object, of the only one of its values that has
    some.
    """
    if not isinstance(value, dict):
        return _list_of_records(value)
    lists = {name: column for name, column in value.items() if _is_column(column)}
    if len(set(map(len, lists.values()))) == 1 and len(lists) > 1:
        return [dict(zip(lists, row, strict=True)) for row in zip(*lists.values(), strict=True)]
    tables = list(filter(None, map(_list_of_records, value.values())))
    return tables[0] if len(tables) == 1 else []


def _list_of_records(value: Any) -> Records:
    is_list = isinstance(value, list) and all(isinstance(record, dict) for record in value)
    return value if is_list else []


def _is_column(value: Any) -> bool:
    is_long = isinstance(value, list) and len(value) > 1
    return is_long and not any(isinstance(cell, list | dict) for cell in value)


def _flattened(value: Any, name: str) -> Iterator[tuple[str, Any]]:
    """Yield the numbers and texts of a record by name; those inside of others have both names."""
    items: Iterable[tuple[Any, Any]]
    if isinstance(value, dict):
        items = value.items()
    elif isinstance(value, list):
        items = enumerate(value) if len(value) <= _LONGEST_VECTOR else ()
    else:
        yield name, "" if value is None else int(value) if isinstance(value, bool) else value
        return
    for key, inner in items:
        yield from _flattened(inner, f"{name}.{key}" if name else str(key))
