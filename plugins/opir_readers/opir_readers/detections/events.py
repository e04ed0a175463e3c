"""Events as JSON: opir's own, one per line, or a list of objects with the same keys."""

import json
from collections.abc import Iterator, Mapping, Sequence
from typing import Any

from opir_core.plugin import BadFileError

#: The keys that a detection's columns are made of; others of an event are what opir's own tracker
#: said.
KEYS = (
    *(
        "timestamp",
        "time_s",
        "reported_at",
        "sensor_id",
        "sensor_position_ecef_m",
        "detection_id",
        "target_id",
    ),
    *("azimuth_deg", "elevation_deg", "right_ascension_deg", "declination_deg"),
    *("line_of_sight_ecef", "line_of_sight_eme2000", "line_of_sight_sigma_urad"),
    *("target_type", "confidence", "snr", "bands"),
)

#: The beginning of a text that is looked at for the mark of an event.
_HEAD = 20_000


def is_of_events(text: str) -> bool:
    """Return whether a text is JSON that begins with a detection."""
    head = text[:_HEAD].lstrip()
    has_direction = any(f'"{name}"' in head for name in (*KEYS[7:11], *KEYS[11:13]))
    return (
        head[:1] in ("{", "[") and has_direction and ('"timestamp"' in head or '"time_s"' in head)
    )


def event_rows(text: str) -> Sequence[Mapping[str, Any]]:
    """Return the detections of a text; raises `BadFileError` with the line that is none."""
    rows = [_row(value, line) for value, line in _values(text)]
    if not rows:
        raise BadFileError("has no detection")
    return rows


def _values(text: str) -> Iterator[tuple[Any, int | None]]:
    """Yield the objects and, of JSON lines, their lines."""
    if text.lstrip()[:1] == "[":
        value = _parsed(text, None)
        yield from ((each, None) for each in (value if isinstance(value, list) else [value]))
        return
    for number, line in enumerate(text.split("\n"), 1):
        if line.strip():
            yield _parsed(line, number), number


def _parsed(text: str, line: int | None) -> Any:
    where = "" if line is None else f"line {line}: "
    try:
        return json.loads(text)
    except json.JSONDecodeError as error:
        more = (
            "; are they objects over several lines? One event a line is read, or a list"
            if line
            else ""
        )
        place = f"line {error.lineno}: " if line is None else where
        raise BadFileError(
            f"{place}is not JSON: {error.msg} (column {error.colno}){more}"
        ) from error
    except (RecursionError, ValueError) as error:
        raise BadFileError(f"{where}is not JSON that can be read: {error}") from error


def _row(value: Any, line: int | None) -> Mapping[str, Any]:
    if not isinstance(value, dict):
        where = "" if line is None else f"line {line}: "
        raise BadFileError(
            f"{where}is no object with keys; a detection has {', '.join(KEYS[:8])}, …"
        )
    row = {name: value[name] for name in KEYS if value.get(name) is not None}
    return row if line is None else {**row, "line": line}
