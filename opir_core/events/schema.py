"""The JSON Schema of the detection event, as it ships in the package."""

from typing import Any

#: The version of the event's shape, which every event carries.
SCHEMA_VERSION = "1.0"


def detection_schema() -> dict[str, Any]:
    """Return the JSON Schema (draft 2020-12) of a detection event."""
    import json

    schema: dict[str, Any] = json.loads(detection_schema_text())
    return schema


def detection_schema_text() -> str:
    """Return the text of the JSON Schema of a detection event."""
    from importlib.resources import files

    return files("opir_core").joinpath("data", "detection.schema.json").read_text(encoding="utf-8")
