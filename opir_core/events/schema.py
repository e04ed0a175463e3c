"""The JSON Schema of the detection event, as it ships in the package."""

from typing import Any

#: The version of the event's shape, which every event carries.
SCHEMA_VERSION = "1.0"


#: The schemas that ship in the package, and the encoder whose messages each describes.
SCHEMAS = {"detection": "forge", "forge-c2": "forge-c2", "udl": "udl"}


def detection_schema() -> dict[str, Any]:
    """Return the JSON Schema (draft 2020-12) of a detection event."""
    return schema("detection")


def detection_schema_text() -> str:
    """Return the text of the JSON Schema of a detection event."""
    return schema_text("detection")


def schema(name: str) -> dict[str, Any]:
    """Return one of `SCHEMAS` (draft 2020-12)."""
    import json

    found: dict[str, Any] = json.loads(schema_text(name))
    return found


def schema_text(name: str) -> str:
    """Return the text of one of `SCHEMAS`."""
    from importlib.resources import files

    return files("opir_core").joinpath("data", f"{name}.schema.json").read_text(encoding="utf-8")
