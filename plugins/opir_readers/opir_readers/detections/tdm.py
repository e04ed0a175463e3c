"""Tracking Data Messages: CCSDS 503.0-B-2, KVN or XML; of each segment the angles of one sensor.

Accepted are angles of the types AZEL, XEYN and XSYE at the sensor, and RADEC in EME2000, ICRF, TEME
and other frames that an OEM may have, in its time systems. Other quantities (ranges, Doppler,
magnitudes) are left out.
"""

import math
import re
from collections.abc import Iterator

from attrs import Factory, define

from opir_core.plugin import BadFileError
from opir_readers.detections.numbers import Row, Rows, finite
from opir_readers.detections.times import date_text, unix_ns
from opir_readers.frames import frame_of, is_of_epoch
from opir_readers.time_systems import SYSTEMS, utc_s
from opir_readers.xml_nodes import XmlNode, has_message, metadata_and_data, xml_root

FIRST_KEYWORD = "CCSDS_TDM_VERS"

_HEAD = re.compile(rf"([^\S\n]*(COMMENT[^\n]*)?\n)*+[^\S\n]*{FIRST_KEYWORD}")
_CELESTIAL = "EME2000, J2000, ICRF, GCRF, TEME, TOD, MOD and CIRS"
_LOCAL = ("azimuth_deg", "elevation_deg")
_KEYS = {
    "AZEL": _LOCAL,
    "XEYN": _LOCAL,
    "XSYE": _LOCAL,
    "RADEC": ("right_ascension_deg", "declination_deg"),
}


#: The keywords of the two angles of a direction.
ANGLES = ("ANGLE_1", "ANGLE_2")


@define
class TdmSegment:
    """The metadata of a segment, and its angles by time: (first, second), with their lines."""

    line: int
    meta: dict[str, str] = Factory(dict)
    angles: dict[str, dict[str, tuple[str, int]]] = Factory(dict)

    @property
    def sensor(self) -> str:
        """Return the participant that received: the last one of PATH, 1 without it."""
        number = self.meta.get("PATH", "1").split(",")[-1].strip()
        name = self.meta.get(f"PARTICIPANT_{number}", "")
        if not name:
            raise BadFileError(
                f"line {self.line}: the metadata lack PARTICIPANT_{number}, the sensor"
            )
        return name

    def target(self) -> str | None:
        """Return the first participant that is not the sensor."""
        names = (value for key, value in self.meta.items() if key.startswith("PARTICIPANT_"))
        return next((name for name in names if name != self.sensor), None)

    def keyword(self, key: str, default: str) -> str:
        """Return the value of a keyword in capitals."""
        return self.meta.get(key, default).upper()

    def take_angle(self, key: str, time: str, value: str, number: int) -> None:
        """Add an angle of a time, in line `number`; raises `BadFileError` for one that stands
        twice.
        """
        pair = self.angles.setdefault(time, {})
        if key in pair:
            raise BadFileError(
                f"line {number}: {key} stands twice for {time}, in line {pair[key][1]} too"
            )
        pair[key] = value, number


def is_tdm(text: str) -> bool:
    """Whether a text is a Tracking Data Message."""
    return _HEAD.match(text) is not None or is_tdm_xml(text)


def tdm_rows(text: str) -> Rows:
    """Return the detections of a message; raises `BadFileError` with the line that is none, or
    lacks an angle.
    """
    segments, keywords = segments_of_xml(text) if is_tdm_xml(text) else _segments(text)
    rows = [row for segment in segments for row in _rows(segment)]
    if not rows:
        has = f"; it has {', '.join(keywords)}" if keywords else ""
        raise BadFileError(f"has no angles (ANGLE_1 and ANGLE_2){has}")
    return rows


def _segments(text: str) -> tuple[list[TdmSegment], list[str]]:
    segments = list[TdmSegment]()
    block = ""
    keywords = dict[str, None]()
    for number, line in enumerate(text.split("\n"), 1):
        words = line.split()
        if not words or words[0] == "COMMENT" or (not segments and words[0] != "META_START"):
            continue
        if words[0] in ("META_START", "DATA_START"):
            block = words[0]
            segments += [TdmSegment(number)] if block == "META_START" else []
        elif words[0] in ("META_STOP", "DATA_STOP"):
            block = ""
        else:
            key, equals, value = (word.strip() for word in line.partition("="))
            if not equals or not block:
                raise BadFileError(
                    f"line {number}: {line.strip()[:60]!r} is not of the form KEYWORD = value in a"
                    " block"
                )
            if block == "META_START":
                segments[-1].meta[key] = value
            elif key in ANGLES:
                _take_angle(segments[-1], key, value, number)
            else:
                keywords[key] = None
    return segments, list(keywords)


def _take_angle(segment: TdmSegment, key: str, value: str, number: int) -> None:
    words = value.split()
    if len(words) != 2:
        raise BadFileError(
            f"line {number}: {key} has {len(words)} values; a time and an angle are needed"
        )
    segment.take_angle(key, words[0], words[1], number)


def _rows(segment: TdmSegment) -> Iterator[Row]:
    if not segment.angles:
        return
    kind = _kind(segment)
    system = segment.keyword("TIME_SYSTEM", "UTC")
    if system not in SYSTEMS:
        raise BadFileError(
            f"line {segment.line}: TIME_SYSTEM is {system!r}; convert the times to one of"
            f" {', '.join(SYSTEMS)}"
        )
    common = {"sensor_id": segment.sensor, "target_id": segment.target()}
    if kind == "RADEC":
        common["reference_frame"] = segment.meta.get("REFERENCE_FRAME", "EME2000")
    common = {name: value for name, value in common.items() if value is not None}
    for time, pair in segment.angles.items():
        key, (_, line) = next(iter(pair.items()))
        if len(pair) < 2:
            raise BadFileError(
                f"line {line}: {key} of {time} stands alone; a direction has two angles"
            )
        angles = [finite(pair[key][0], f"line {pair[key][1]}: {key}") for key in ANGLES]
        angles = [
            angle + _correction(segment, key) for angle, key in zip(angles, ANGLES, strict=True)
        ]
        angles = _of_gimbals(kind, *angles) if kind in ("XEYN", "XSYE") else angles
        directions = dict(zip(_KEYS[kind], angles, strict=True))
        yield {"line": line, "timestamp": _utc_text(time, line, system), **directions, **common}


def _of_gimbals(kind: str, x_deg: float, y_deg: float) -> list[float]:
    """Return azimuth and elevation, deg, of the angles of an antenna with two horizontal axes.

    X turns from the zenith towards east (XEYN) or south (XSYE), Y from there towards north or east.
    """
    x = math.radians(x_deg)
    y = math.radians(y_deg)
    along_x = math.cos(y) * math.sin(x)
    along_y = math.sin(y)
    up = math.cos(y) * math.cos(x)
    east, north = (along_x, along_y) if kind == "XEYN" else (along_y, -along_x)
    return [
        math.degrees(math.atan2(east, north)) % 360.0,
        math.degrees(math.asin(max(min(up, 1.0), -1.0))),
    ]


def _utc_text(time: str, line: int, system: str) -> str:
    """Return a time of another system as a date in UTC."""
    calendar_ns = unix_ns(time, f"line {line}: the time")
    seconds = calendar_ns * 1e-9
    return date_text(calendar_ns - round((seconds - utc_s(seconds, system)) * 1e3) * 1_000_000)


def _kind(segment: TdmSegment) -> str:
    """Return the type of a segment's angles; raises `BadFileError` for one that is not read."""
    kind = segment.keyword("ANGLE_TYPE", "")
    frame = segment.meta.get("REFERENCE_FRAME", "EME2000")
    complaint = ""
    if kind not in _KEYS:
        complaint = f"ANGLE_TYPE is {kind or 'missing'}; read are {' and '.join(_KEYS)}"
    elif kind == "RADEC" and (frame_of(frame) in ("", "ITRF") or is_of_epoch(frame)):
        complaint = f"REFERENCE_FRAME is {frame}; read are {_CELESTIAL}"
    elif segment.keyword("TIMETAG_REF", "RECEIVE") != "RECEIVE":
        complaint = f"TIMETAG_REF is {segment.meta['TIMETAG_REF']}; only RECEIVE is read"
    if complaint:
        raise BadFileError(f"line {segment.line}: {complaint}")
    return kind


def _correction(segment: TdmSegment, angle: str) -> float:
    """Return the correction of an angle, deg, that its values do not have yet."""
    key = f"CORRECTION_{angle}"
    if key not in segment.meta or segment.keyword("CORRECTIONS_APPLIED", "NO") == "YES":
        return 0.0
    return finite(segment.meta[key], f"line {segment.line}: {key}")


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
