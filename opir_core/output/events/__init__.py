"""Detection events: versions and JSON Schemas of the messages; each encoder is a module of its
own.
"""

import json
from pathlib import Path
from typing import Any

from opir_core.reading.format_versions import EVENT_FORMAT

#: Schema version of the detection event, in every event.
SCHEMA_VERSION = EVENT_FORMAT.version

#: Schema version of the encoder `tracks`, in the headers of its messages.
TRACKS_VERSION = "tracks-1.0"

_DATA = Path(__file__).parents[2] / "data"

#: Schemas in the package.
SCHEMAS = ("detection", "track")


def detection_schema(*, is_closed: bool = False) -> dict[str, Any]:
    """Return the JSON Schema (draft 2020-12) of a detection event; see `schema`."""
    return schema("detection", is_closed=is_closed)


def schema(name: str, *, is_closed: bool = False) -> dict[str, Any]:
    """Return one of `SCHEMAS` (draft 2020-12).

    It is open for readers: later minor versions may add fields. A closed one permits no field that
    it does not name, as tests of a writer need.
    """
    return json.loads(schema_text(name), object_hook=_closed if is_closed else None)


def _closed(value: dict[str, Any]) -> dict[str, Any]:
    """Return an object of a schema that permits the properties that it names alone."""
    if isinstance(value.get("properties"), dict):
        return {"additionalProperties": False, **value}
    return value


def schema_text(name: str) -> str:
    """Return the text of one of `SCHEMAS`."""
    return (_DATA / f"{name}.schema.json").read_text(encoding="utf-8")
