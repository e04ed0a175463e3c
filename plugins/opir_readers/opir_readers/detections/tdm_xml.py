"""Tracking Data Messages in the XML form (CCSDS 505.0-B), alone or in a message of several
(ndm).
"""

from opir_readers.detections.tdm_segments import ANGLES, TdmSegment
from opir_readers.xml_nodes import XmlNode, has_message, metadata_and_data, xml_root


def is_tdm_xml(text: str) -> bool:
    """Whether a text is a TDM in XML, or a message of several that has one."""
    return has_message(text, "tdm")


def segments_of_xml(text: str) -> tuple[list[TdmSegment], list[str]]:
    """Return the segments of a message, and the keywords of its values other than angles."""
    root = xml_root(text)
    messages = [root] if root.name == "tdm" else list(root.all("tdm"))
    keywords = dict[str, None]()
    segments = [_segment(node, keywords) for message in messages for node in message.all("segment")]
    return segments, list(keywords)


def _segment(node: XmlNode, keywords: dict[str, None]) -> TdmSegment:
    meta, data = metadata_and_data(node)
    segment = TdmSegment(meta.line, meta.texts())
    for observation in data.all("observation"):
        time = observation.text_of("EPOCH")
        for value in observation.children:
            if value.name in ANGLES:
                segment.take_angle(value.name, time, value.text, value.line)
            elif value.name != "EPOCH":
                keywords[value.name] = None
    return segment
