"""Orbit Ephemeris Messages: CCSDS 502.0-B-3, section 5, in the keyword form (KVN).

Accepted are states in UTC, UT1, TAI, GPS, TT and TDB, in the Earth-fixed frames ITRF (any
realisation), TDR, GRC and TIRS, in TEME, TOD, MOD and CIRS, of date or of REF_FRAME_EPOCH, and in
EME2000 (J2000; also used for GCRF and ICRF, which differ from it by 0.02 arcseconds); other frames
and time systems are rejected by name. Covariances are left out. The library `oem`, a reference in
the tests, needs astropy and reports most errors without line and remedy.
"""

import math
from typing import NamedTuple

import numpy as np
from attrs import Factory, define

from opir_core.arrays import FloatArray
from opir_core.plugin import BadFileError, StateTable
from opir_readers.frames import FRAME_NAMES, frame_of, is_of_epoch, to_ecef
from opir_readers.states import number_or_nan, require_order, require_places, require_velocities
from opir_readers.time_systems import SYSTEMS, unix_s
from opir_readers.xml_nodes import XmlNode, has_message, metadata_and_data, xml_root

_NEEDED = (
    "OBJECT_NAME",
    "OBJECT_ID",
    "CENTER_NAME",
    "REF_FRAME",
    "TIME_SYSTEM",
    "START_TIME",
    "STOP_TIME",
)


class _States(NamedTuple):
    """Scene times (n,), s, and states (n, 3) in ECEF, m and m/s."""

    time_s: FloatArray
    position_m: FloatArray
    velocity_m_s: FloatArray


@define
class Segment:
    """A stretch of states with its metadata; `line` is that of META_START."""

    line: int
    meta: dict[str, str] = Factory(dict)
    lines: list[int] = Factory(list)
    states: list[list[float]] = Factory(list)
    width: int = 0
    has_covariance: bool = False

    def take_keyword(self, line: str, number: int) -> None:
        """Add a line of metadata."""
        key, equals, value = (word.strip() for word in line.partition("="))
        if not equals:
            raise BadFileError(
                f"line {number}: {line.strip()!r} is not of the form KEYWORD = value"
            )
        if key in self.meta:
            raise BadFileError(
                f"line {number}: {key} stands twice in these metadata; leave one out"
            )
        self.meta[key] = value

    def take_state(self, words: list[str], number: int) -> None:
        """Add a line of a state."""
        if self.has_covariance:
            raise BadFileError(
                f"line {number}: comes after the segment's covariance, where no state can be"
            )
        state = self._state(words, number)
        self.width = self.width or len(words)
        if len(words) != self.width:
            raise BadFileError(
                f"line {number}: has {len(words)} values, the segment's first state {self.width};"
                " all states of a segment have accelerations, or none has"
            )
        self.lines.append(number)
        self.states.append(state)

    def _state(self, words: list[str], number: int) -> list[float]:
        """Return a line's time, s since 1970, and state, km and km/s; accelerations are left."""
        if len(words) not in (7, 10):
            raise BadFileError(
                f"line {number}: has {len(words)} values; a state has a time and 6 (or 9) numbers"
            )
        numbers = list(map(number_or_nan, words[1:]))
        for word, value in zip(words[1:], numbers, strict=True):
            if math.isnan(value):
                raise BadFileError(f"line {number}: {word!r} is not a finite number")
        return [unix_s(words[0], number, self.system), *numbers[:6]]

    @property
    def system(self) -> str:
        """Return the time system."""
        return self.meta["TIME_SYSTEM"].upper()

    def scene_s(self, key: str, epoch_us: int) -> float | None:
        """Return the scene time of a keyword, s; None where it is missing."""
        text = self.meta.get(key)
        if text is None or (key == "REF_FRAME_EPOCH" and not text):
            return None
        return unix_s(text, self.line, self.system) - epoch_us * 1e-6


def oem_table(text: str, epoch_us: int, name: str | None) -> StateTable:
    """Return the table of a message, for a scene epoch in microseconds of UTC since 1970.

    `name` is the OBJECT_NAME or OBJECT_ID to take where there are several objects. Each segment is
    a run; the burn is the useable interval. Raises `BadFileError`.
    """
    return table_of_segments(segments_of_text(text), epoch_us, name)


def table_of_segments(segments: list[Segment], epoch_us: int, name: str | None) -> StateTable:
    """Return the table of the segments of a message; as `oem_table`."""
    segments = _of_object(segments, name)
    stretches = [_states(segment, epoch_us) for segment in segments]
    for number, segment in enumerate(segments[1:]):
        if stretches[number].time_s[-1] != stretches[number + 1].time_s[0]:
            raise BadFileError(
                f"line {segment.line}: this segment does not start when the one before it ends;"
                " split the file or make them meet"
            )
    time_s, position, velocity = (np.concatenate(column) for column in zip(*stretches, strict=True))
    lines = [line for segment in segments for line in segment.lines]
    has_covariance = any(segment.has_covariance for segment in segments)
    meta = segments[0].meta
    frozen = f" of {meta['REF_FRAME_EPOCH']}" if meta.get("REF_FRAME_EPOCH") else ""
    return StateTable(
        time_s,
        position,
        velocity,
        np.repeat(np.arange(len(segments)), [len(segment.lines) for segment in segments]),
        np.array([_useable_s(segments, epoch_us, time_s)]),
        lines.__getitem__,
        ("covariances are not read",) if has_covariance else (),
        has_dates=True,
        frame=f"{meta['REF_FRAME']}{frozen}, times in {meta['TIME_SYSTEM']}",
    )


def segments_of_text(text: str) -> list[Segment]:
    """Return the segments of a message in the keyword form; raises `BadFileError`."""
    segments = []
    block = ""
    for number, line in enumerate(text.splitlines(), 1):
        words = line.split()
        if not words or words[0] == "COMMENT":
            continue
        if words[0] in ("META_START", "COVARIANCE_START"):
            _require_none(block, number)
            block = words[0]
            segments += [Segment(number)] if block == "META_START" else []
        elif words[0] in ("META_STOP", "COVARIANCE_STOP"):
            block = ""
            require_meta(segments, number)
            segments[-1].has_covariance = words[0] == "COVARIANCE_STOP"
        elif block == "META_START":
            segments[-1].take_keyword(line, number)
        elif block == "" and segments:
            segments[-1].take_state(words, number)
    _require_whole(segments, block)
    return segments


def _require_whole(segments: list[Segment], block: str) -> None:
    if block:
        raise BadFileError(f"ends within a block that began with {block}")
    if not segments:
        raise BadFileError("has no META_START, so no states")


def _require_none(block: str, number: int) -> None:
    if block:
        raise BadFileError(f"line {number}: begins a block within one that began with {block}")


def require_meta(segments: list[Segment], number: int) -> None:
    """Raise `BadFileError` where the metadata of the last segment lack something, or name a centre,
    a frame or a time system that is not read.
    """
    if not segments:
        raise BadFileError(f"line {number}: ends a block that never began")
    meta = segments[-1].meta
    missing = [key for key in _NEEDED if not meta.get(key)]
    if missing:
        raise BadFileError(f"line {number}: the metadata lack {', '.join(missing)}")
    frame = meta["REF_FRAME"]
    complaint = ""
    if meta["CENTER_NAME"].upper() != "EARTH":
        complaint = f"CENTER_NAME is {meta['CENTER_NAME']!r}; only EARTH is taken"
    elif segments[-1].system not in SYSTEMS:
        known = ", ".join(SYSTEMS)
        complaint = f"TIME_SYSTEM is {meta['TIME_SYSTEM']!r}; convert the times to one of {known}"
    elif not frame_of(frame):
        complaint = f"REF_FRAME is {frame!r}; convert the states to one of {FRAME_NAMES}"
    elif is_of_epoch(frame) and not meta.get("REF_FRAME_EPOCH"):
        complaint = f"REF_FRAME is {frame!r} and REF_FRAME_EPOCH is missing"
    if complaint:
        raise BadFileError(f"line {number}: {complaint}")


def _of_object(segments: list[Segment], name: str | None) -> list[Segment]:
    names = dict.fromkeys(segment.meta["OBJECT_NAME"] for segment in segments)
    if name is not None:
        keys = ("OBJECT_NAME", "OBJECT_ID")
        segments = [s for s in segments if name in (s.meta[key] for key in keys)]
    if not segments:
        raise BadFileError(f"has no object {name!r}; it has {', '.join(names)}")
    if len({segment.meta["OBJECT_NAME"] for segment in segments}) > 1:
        raise BadFileError(f"has several objects; say which with object: {', '.join(names)}")
    return segments


def _states(segment: Segment, epoch_us: int) -> _States:
    if len(segment.states) < 2:
        raise BadFileError(f"line {segment.line}: this segment has fewer than 2 states")
    line_of = segment.lines.__getitem__
    rows = np.array(segment.states)
    time_s = rows[:, 0] - epoch_us * 1e-6
    require_order(time_s, line_of, may_repeat=False)
    with np.errstate(over="ignore"):
        rows[:, 1:] *= 1e3
    position = rows[:, 1:4]
    velocity = rows[:, 4:7]
    require_places(position, line_of)
    require_velocities(velocity, line_of)
    frame = frame_of(segment.meta["REF_FRAME"])
    frame_s = segment.scene_s("REF_FRAME_EPOCH", epoch_us)
    return _States(time_s, *to_ecef(frame, position, velocity, epoch_us, time_s, frame_s))


def _useable_s(segments: list[Segment], epoch_us: int, time_s: FloatArray) -> tuple[float, float]:
    """Return the first and last useable scene times of the message."""
    start = segments[0].scene_s("USEABLE_START_TIME", epoch_us)
    stop = segments[-1].scene_s("USEABLE_STOP_TIME", epoch_us)
    begin = float(time_s[0])
    end = float(time_s[-1])
    return (begin if start is None else max(start, begin)), (
        end if stop is None else min(stop, end)
    )


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
