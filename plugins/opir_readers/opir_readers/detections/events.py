"""Events as JSON: opir's own, one per line, or a list of objects with the same keys."""

import json
from collections.abc import Iterator, Sequence
from typing import Any

from opir_core.plugin import BadFileError
from opir_core.reading import EVENT_FORMAT, HEARTBEAT_FORMAT, Format
from opir_readers.detections.heartbeats import HEARTBEAT, HEARTBEATS, is_heartbeat
from opir_readers.detections.numbers import NOTES, Row, Rows

#: Characters by which a file is recognised.
_HEAD = 20_000

#: The keys of times, and of directions.
_TIMES = ("timestamp", "time_s")
_DIRECTIONS = (
    "azimuth_deg",
    "elevation_deg",
    "right_ascension_deg",
    "declination_deg",
    "line_of_sight_ecef",
    "line_of_sight_eme2000",
)

#: The keys that a detection's columns are made of; the other keys of an event are the answers of
#: opir's own tracker.
KEYS = (
    *_TIMES,
    "reported_at",
    "sensor_id",
    "sensor_position_ecef_m",
    "detection_id",
    "target_id",
    *_DIRECTIONS,
    "line_of_sight_sigma_urad",
    "target_type",
    "confidence",
    "snr",
    "bands",
)


def is_of_events(text: str) -> bool:
    """Whether a text is JSON that begins with a detection."""
    head = text[:_HEAD].lstrip()
    if f'"{HEARTBEAT}"' in head:
        # Before the first detection there may be many.
        head = head[0] + text[text.find('"detection_id"') :][:_HEAD]
    return head[:1] in ("{", "[") and all(
        any(f'"{name}"' in head for name in names) for names in (_DIRECTIONS, _TIMES)
    )


def event_rows(text: str) -> Rows:
    """Return the detections of a text; raises `BadFileError` with the line of another value."""
    values = list(_values(text))
    events = [(value, line) for value, line in values if not is_heartbeat(value)]
    of_beats = [(value, line) for value, line in values if is_heartbeat(value)]
    notes = _version_notes(events, EVENT_FORMAT) + _version_notes(of_beats, HEARTBEAT_FORMAT)
    rows = [_row(value, line) for value, line in events]
    if not rows:
        raise BadFileError("has no detection")
    beats = [{**value, "line": line} for value, line in of_beats]
    beside = {**({HEARTBEATS: beats} if beats else {}), **({NOTES: notes} if notes else {})}
    return [{**rows[0], **beside}, *rows[1:]] if beside else rows


def _version_notes(values: Sequence[tuple[Any, int | None]], kind: Format) -> list[str]:
    """Return what there is to say of the versions of a format; `BadFileError` for one not read."""
    stated = dict[str, int | None]()
    for value, line in values:
        version = value.get("schema_version") if isinstance(value, dict) else None
        if version is not None:
            stated.setdefault(str(version), line)
    for version, line in stated.items():
        if refusal := kind.refusal(version):
            raise BadFileError(f"{_place(line)}schema_version: {refusal}")
    return [note for version in stated if (note := kind.note(version))]


def _values(text: str) -> Iterator[tuple[Any, int | None]]:
    """Yield the objects and, of JSON lines, their lines."""
    if text.lstrip()[:1] == "[":
        value = _parsed(text, None)
        yield from ((item, None) for item in (value if isinstance(value, list) else [value]))
        return
    for number, line in enumerate(text.split("\n"), 1):
        if line.strip():
            yield _parsed(line, number), number


def _place(line: int | None) -> str:
    return "" if line is None else f"line {line}: "


def _parsed(text: str, line: int | None) -> Any:
    try:
        return json.loads(text)
    except json.JSONDecodeError as error:
        more = "; are they objects over several lines? One event a line is read, or a list"
        raise BadFileError(
            f"{_place(line or error.lineno)}is not JSON: {error.msg} (column {error.colno})"
            f"{more if line else ''}"
        ) from error
    except (RecursionError, ValueError) as error:
        raise BadFileError(f"{_place(line)}is not JSON that can be read: {error}") from error


def _row(value: Any, line: int | None) -> Row:
    if not isinstance(value, dict):
        raise BadFileError(
            f"{_place(line)}is no object with keys; a detection has {', '.join(KEYS[:8])}, …"
        )
    row = {name: value[name] for name in KEYS if value.get(name) is not None}
    return row if line is None else {**row, "line": line}
