"""Detection events: versions and JSON Schemas of the messages; each encoder is a module of its
own.
"""

from typing import Any

#: Schema version of the detection event, in every event.
SCHEMA_VERSION = "2.0"

#: Schema version of the encoder `tracks`, in the headers of its messages.
TRACKS_VERSION = "tracks-1.0"

#: Schemas in the package.
SCHEMAS = ("detection", "track")


def detection_schema() -> dict[str, Any]:
    """Return the JSON Schema (draft 2020-12) of a detection event."""
    return schema("detection")


def schema(name: str) -> dict[str, Any]:
    """Return one of `SCHEMAS` (draft 2020-12)."""
    import json

    return json.loads(schema_text(name))


def schema_text(name: str) -> str:
    """Return the text of one of `SCHEMAS`."""
    from importlib.resources import files

    return files("opir_core").joinpath("data", f"{name}.schema.json").read_text(encoding="utf-8")
