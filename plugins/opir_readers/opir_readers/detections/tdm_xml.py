"""Tracking Data Messages in the XML form (CCSDS 505.0-B), alone or in a message of several
(ndm).
"""

from collections import Counter

from opir_core.plugin import BadFileError
from opir_readers.detections.tdm_segments import ANGLES, TdmSegment
from opir_readers.xml_nodes import XmlNode, root_name, xml_root


def is_tdm_xml(text: str) -> bool:
    """Return whether a text is a TDM in XML, or a message of several that has one."""
    name = root_name(text) if text.lstrip()[:1] == "<" else ""
    return name == "tdm" or (name == "ndm" and "<tdm" in text)


def segments_of_xml(text: str) -> tuple[list[TdmSegment], Counter[str]]:
    """Return the segments of a message, and how many values of other kinds than angles it has."""
    root = xml_root(text)
    messages = [root] if root.name == "tdm" else list(root.all("tdm"))
    segments = list[TdmSegment]()
    others = Counter[str]()
    for node in (segment for message in messages for segment in message.all("segment")):
        segments.append(_segment(node, others))
    return segments, others


def _segment(node: XmlNode, others: Counter[str]) -> TdmSegment:
    meta = node.child("metadata")
    data = node.child("data")
    if meta is None or data is None:
        raise BadFileError(
            f"line {node.line}: this segment has no {'metadata' if meta is None else 'data'}"
        )
    segment = TdmSegment(
        meta.line, {each.name: each.text for each in meta.children if each.name != "COMMENT"}
    )
    for observation in data.all("observation"):
        time = observation.text_of("EPOCH")
        for each in observation.children:
            if each.name in ANGLES:
                segment.take_angle(each.name, time, each.text, each.line)
            elif each.name != "EPOCH":
                others[each.name] += 1
    return segment
