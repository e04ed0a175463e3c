"""JSON as the text of a table: names of columns in its first line, then a line for each record."""

import csv
import io
import json
from collections.abc import Iterator, Mapping, Sequence
from typing import Any

#: Lists in a record that are longer than this are no vectors.
_LONGEST_VECTOR = 9


def table_of_json(text: str) -> str | None:
    """Return the records of JSON as comma-separated text, None for what is no JSON table.

    A table is a list of records, records a line each, lists by name, or an object with one of these
    among its values. Parts of a record have names like `position.x` and `position.0`.
    """
    records = _records(_value(text)) if text.lstrip()[:1] in ("{", "[") else None
    if records is None:
        return None
    rows = [dict(_parts(record, "")) for record in records]
    if sum(any(isinstance(each, int | float) for each in row.values()) for row in rows) < 2:
        return None
    names = list(dict.fromkeys(name for row in rows for name in row))
    table = io.StringIO()
    writer = csv.writer(table, lineterminator="\n")
    writer.writerows([names, *([row.get(name, "") for name in names] for row in rows)])
    return table.getvalue()


def _value(text: str) -> Any:
    """Return the value of JSON, of several lines of it the list of their values, None for what is
    none.
    """
    try:
        return json.loads(text)
    except (ValueError, RecursionError):
        pass
    try:
        return [json.loads(line) for line in text.split("\n") if line.strip()]
    except (ValueError, RecursionError):
        return None


def _records(value: Any) -> Sequence[Mapping[str, Any]] | None:
    """Return the records of a value or, of an object, of the only one of its values that has
    some.
    """
    if not isinstance(value, dict):
        return _list_of_records(value)
    lists = {
        name: each for name, each in value.items() if isinstance(each, list) and _is_flat(each)
    }
    if len({len(each) for each in lists.values()}) == 1 and len(lists) > 1:
        return [dict(zip(lists, row, strict=True)) for row in zip(*lists.values(), strict=True)]
    found = [records for each in value.values() if (records := _list_of_records(each))]
    return found[0] if len(found) == 1 else None


def _list_of_records(value: Any) -> Sequence[Mapping[str, Any]] | None:
    is_list = (
        isinstance(value, list) and bool(value) and all(isinstance(each, dict) for each in value)
    )
    return value if is_list else None


def _is_flat(values: Sequence[Any]) -> bool:
    return len(values) > 1 and not any(isinstance(each, list | dict) for each in values)


def _parts(value: Any, name: str) -> Iterator[tuple[str, Any]]:
    """Yield the numbers and texts of a record by name; those inside of others have both names."""
    if isinstance(value, dict):
        inner = value.items()
    elif isinstance(value, list) and len(value) <= _LONGEST_VECTOR:
        inner = {str(place): each for place, each in enumerate(value)}.items()
    else:
        if not isinstance(value, list):
            yield name, "" if value is None else int(value) if isinstance(value, bool) else value
        return
    for own, each in inner:
        yield from _parts(each, f"{name}.{own}" if name else str(own))
