"""What a text looks like that no reader recognises: formats that are known by their beginnings."""

import json
import re

from opir_readers.xml_nodes import root_name

_SHOWN = 8

#: Beginnings, as patterns, and what a text that begins so looks like.
_HEADS = (
    (r"CCSDS_OCM_VERS", "a CCSDS OCM: export the trajectory as OEM"),
    (r"CCSDS_OPM_VERS", "a CCSDS OPM, which has one state: propagate it, and export an OEM"),
    (r"CCSDS_([A-Z]{3})_VERS", "a CCSDS {}, which has no trajectory"),
    (r"(?i)h1\s+cpf\b", "ILRS predictions (CPF): export them as SP3"),
    (r"(?i)h1\s+crd\b", "ILRS laser ranges (CRD), which have no trajectory"),
    (r"\s{0,5}[\d.]+\s+\S.*RINEX VERSION", "RINEX"),
    (r"(?i)<!doctype html|<html", "a web page"),
    (
        r"(<\?xml[^>]*>\s*)?<!DOCTYPE",
        "XML with a document type, which is not read: leave out the line <!DOCTYPE …>",
    ),
    (r"%PDF", "PDF"),
    (r"PK", "a ZIP file, a KMZ or a spreadsheet: unpack it, or export CSV"),
    (r"(CDF|\x89?HDF)", "HDF5"),
    (r"DAF/SPK|KPL/", "a SPICE kernel: export its states as OEM"),
    (r"BEGIN_ICF|\{\\rtf", "text of a word processor"),
)


def likeness(text: str) -> str:
    """Return what a text looks like, "" where nothing is known of it."""
    if "\n$$SOE" in text:
        return (
            "a table of JPL Horizons: give its lines between $$SOE and $$EOE below a line of names,"
            " as CSV"
        )
    head = text.lstrip("\ufeff \t\r\n")
    for pattern, words in _HEADS:
        match = re.match(pattern, text) or re.match(pattern, head)
        if match:
            return words.format(*match.groups())
    if head[:1] == "<":
        name = root_name(head)
        return f"XML with the outermost element {name}" if name else "XML or HTML"
    return _of_json(head) if head[:1] in ("{", "[") else ""


def _of_json(text: str) -> str:
    try:
        value = json.loads(text)
    except (ValueError, RecursionError):
        return "JSON that is cut off, or several lines of it"
    value = value[0] if isinstance(value, list) and value else value
    if isinstance(value, dict) and value.get("id") == "document":
        return "CZML: export the trajectory as STK ephemeris (.e), OEM or CSV"
    if isinstance(value, dict) and value.get("type") in ("Feature", "FeatureCollection"):
        return "GeoJSON, whose places have no times: export GPX, KML with times or CSV"
    keys = list(value)[:_SHOWN] if isinstance(value, dict) else []
    return f"JSON with the keys {', '.join(map(str, keys))}" if keys else "JSON"
