"""What a text looks like that no reader recognises: formats that are known by their beginnings."""

import json
import re

from opir_readers.xml_nodes import root_name

_SHOWN = 8

#: Beginnings, as patterns, and what a text that begins so looks like.
_HEADS = (
    (r"CCSDS_(OPM|OCM|AEM|APM|CDM|RDM)_VERS", "a CCSDS {}, in which there is no flight"),
    (r"\s{0,5}[\d.]+\s+\S.*RINEX VERSION", "RINEX"),
    (r"(?i)<!doctype html|<html", "a web page"),
    (r"%PDF", "PDF"),
    (r"PK", "a ZIP file, a KMZ or a spreadsheet: unpack it, or export CSV"),
    (r"(CDF|\x89?HDF)", "HDF5"),
    (r"DAF/SPK|KPL/", "a SPICE kernel: export its states as OEM"),
    (r"BEGIN_ICF|\{\\rtf", "text of a word processor"),
)


def likeness(text: str) -> str:
    """Return what a text looks like, "" where nothing is known of it."""
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
    keys = list(value)[:_SHOWN] if isinstance(value, dict) else []
    return f"JSON with the keys {', '.join(map(str, keys))}" if keys else "JSON"
