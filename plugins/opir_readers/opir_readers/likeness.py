"""The formats that texts look like which no reader recognises, by their beginnings."""

import json
import re

from opir_readers.published import published
from opir_readers.xml_nodes import root_name


def likeness(text: str) -> str:
    """Return what a text looks like, "" for a beginning that is not known."""
    if "\n$$SOE" in text:
        return (
            "a table of JPL Horizons: give its lines between $$SOE and $$EOE below a line of names,"
            " as CSV"
        )
    head = text.lstrip("\ufeff \t\r\n")
    for pattern, words in published("beginnings")["texts"]:
        match = re.match(pattern, text) or re.match(pattern, head)
        if match:
            return words.format(*match.groups())
    if head[:1] == "<":
        name = root_name(head)
        return f"XML with the outermost element {name}" if name else "XML or HTML"
    return _likeness_of_json(head) if head[:1] in ("{", "[") else ""


def _likeness_of_json(text: str) -> str:
    try:
        value = json.loads(text)
    except (ValueError, RecursionError):
        return "JSON that is cut off, or several lines of it"
    value = value[0] if isinstance(value, list) and value else value
    if not isinstance(value, dict):
        return "JSON"
    if value.get("id") == "document":
        return "CZML: export the trajectory as STK ephemeris (.e), OEM or CSV"
    if value.get("type") in ("Feature", "FeatureCollection"):
        return "GeoJSON, whose places have no times: export GPX, KML with times or CSV"
    keys = ", ".join(list(value)[:8])
    return f"JSON with the keys {keys}" if keys else "JSON"
