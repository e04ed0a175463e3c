"""Orbit Ephemeris Messages in the XML form (CCSDS 505.0-B), alone or in a message of several
(ndm).
"""

from opir_core.plugin import BadFileError, StateTable
from opir_readers.oem_table import Segment, require_meta, table_of_segments
from opir_readers.xml_nodes import XmlNode, root_name, xml_root

_STATE = ("EPOCH", "X", "Y", "Z", "X_DOT", "Y_DOT", "Z_DOT")


def is_oem_xml(text: str) -> bool:
    """Return whether a text is an OEM in XML, or a message of several that has one."""
    name = root_name(text) if text.lstrip()[:1] == "<" else ""
    return name == "oem" or (name == "ndm" and "<oem" in text)


def oem_xml_table(text: str, epoch_us: int, wanted: str | None) -> StateTable:
    """Return the table of a message, as `oem_table` does of the keyword form."""
    segments = [_segment(node) for node in xml_root(text).all("segment")]
    if not segments:
        raise BadFileError("has no segment, so no states")
    return table_of_segments(segments, epoch_us, wanted)


def _segment(node: XmlNode) -> Segment:
    segment = Segment(node.line)
    meta = node.child("metadata")
    data = node.child("data")
    if meta is None or data is None:
        raise BadFileError(
            f"line {node.line}: this segment has no {'metadata' if meta is None else 'data'}"
        )
    for each in meta.children:
        if each.name != "COMMENT":
            segment.meta[each.name] = each.text
    require_meta([segment], meta.line)
    for state in data.all("stateVector"):
        words = [state.text_of(name) for name in _STATE]
        missing = [name for name, word in zip(_STATE, words, strict=True) if not word]
        if missing:
            raise BadFileError(f"line {state.line}: this state lacks {', '.join(missing)}")
        _require_units(state)
        segment.take_state(words, state.line)
    segment.has_covariance = any(True for _ in data.all("covarianceMatrix"))
    return segment


def _require_units(state: XmlNode) -> None:
    for node in state.children:
        unit = node.attributes.get("units", "")
        due = "km/s" if node.name.endswith("_DOT") else "km"
        if node.name in _STATE[1:] and unit and unit != due:
            raise BadFileError(f"line {node.line}: {node.name} is in {unit}; {due} is due")
