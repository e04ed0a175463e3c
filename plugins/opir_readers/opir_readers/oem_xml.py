"""Orbit Ephemeris Messages in the XML form (CCSDS 505.0-B), alone or in a message of several
(ndm).
"""

from opir_core.plugin import BadFileError, StateTable
from opir_readers.oem_table import Segment, require_meta, table_of_segments
from opir_readers.xml_nodes import XmlNode, has_message, metadata_and_data, xml_root

_STATE = ("EPOCH", "X", "Y", "Z", "X_DOT", "Y_DOT", "Z_DOT")


def is_oem_xml(text: str) -> bool:
    """Whether a text is an OEM in XML, or a message of several that has one."""
    return has_message(text, "oem")


def oem_xml_table(text: str, epoch_us: int, name: str | None) -> StateTable:
    """Return the table of a message, as `oem_table` does of the keyword form."""
    segments = [_segment(node) for node in xml_root(text).all("segment")]
    if not segments:
        raise BadFileError("has no segment, so no states")
    return table_of_segments(segments, epoch_us, name)


def _segment(node: XmlNode) -> Segment:
    meta, data = metadata_and_data(node)
    segment = Segment(node.line, meta.texts())
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
        needed = "km/s" if node.name.endswith("_DOT") else "km"
        if node.name in _STATE[1:] and unit and unit != needed:
            raise BadFileError(f"line {node.line}: {node.name} is in {unit}; {needed} is due")
