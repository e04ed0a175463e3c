"""The detection event: its identifiers, its timestamps, its schemas and its encoders.

The encoders are in modules of their own, which are imported when a scene chooses one.
"""

from typing import Any

#: The version of the event's shape, which every event carries.
SCHEMA_VERSION = "1.0"


#: The versions of the shapes of other encoders, which their messages' headers carry.
FORGE_C2_VERSION, UDL_VERSION = "forge-c2-1.0", "udl-1.0"

#: The schemas that ship in the package: the encoder whose messages each describes, and their version.
SCHEMAS = {
    "detection": ("forge", SCHEMA_VERSION),
    "forge-c2": ("forge-c2", FORGE_C2_VERSION),
    "udl": ("udl", UDL_VERSION),
}


def detection_schema() -> dict[str, Any]:
    """Return the JSON Schema (draft 2020-12) of a detection event."""
    return schema("detection")


def schema(name: str) -> dict[str, Any]:
    """Return one of `SCHEMAS` (draft 2020-12)."""
    import json

    found: dict[str, Any] = json.loads(schema_text(name))
    return found


def schema_text(name: str) -> str:
    """Return the text of one of `SCHEMAS`."""
    from importlib.resources import files

    return files("opir_core").joinpath("data", f"{name}.schema.json").read_text(encoding="utf-8")
