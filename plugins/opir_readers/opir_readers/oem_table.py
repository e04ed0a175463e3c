"""Orbit Ephemeris Messages: CCSDS 502.0-B-3, section 5, in the keyword form (KVN).

Accepted are states in UTC, UT1, TAI, GPS, TT and TDB, in the Earth-fixed frames ITRF (any
realisation), TDR, GRC and TIRS, in TEME, TOD, MOD and CIRS, of date or of REF_FRAME_EPOCH, and in
EME2000 (J2000; also used for GCRF and ICRF, which differ from it by 0.02 arcseconds); other frames
and time systems are rejected by name. Covariances are left out. The library `oem`, a reference in
the tests, needs astropy and reports most errors without line and remedy.
"""

import math

import numpy as np
from attrs import Factory, define

from opir_core.plugin import BadFileError, StateTable
from opir_readers.frames import FRAME_NAMES, frame_of, is_of_epoch, to_ecef
from opir_readers.states import require_order, require_places, require_velocities
from opir_readers.time_systems import SYSTEMS, unix_s

_NEEDED = (
    "OBJECT_NAME",
    "OBJECT_ID",
    "CENTER_NAME",
    "REF_FRAME",
    "TIME_SYSTEM",
    "START_TIME",
    "STOP_TIME",
)


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
        key, equals, value = (part.strip() for part in line.partition("="))
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
        state = _state(words, number, self.meta["TIME_SYSTEM"].upper())
        self.width = self.width or len(words)
        if len(words) != self.width:
            raise BadFileError(
                f"line {number}: has {len(words)} values, the segment's first state {self.width};"
                " all states of a segment have accelerations, or none has"
            )
        self.lines.append(number)
        self.states.append(state)


def oem_table(text: str, epoch_us: int, wanted: str | None) -> StateTable:
    """Return the table of a message, for a scene epoch in microseconds of UTC since 1970.

    `wanted` is the OBJECT_NAME or OBJECT_ID to take where there are several objects. Each segment
    is a run; the burn is the useable interval. Raises `BadFileError`.
    """
    return table_of_segments(segments_of_text(text), epoch_us, wanted)


def table_of_segments(segments: list[Segment], epoch_us: int, wanted: str | None) -> StateTable:
    """Return the table of the segments of a message; as `oem_table`."""
    segments = _of_object(segments, wanted)
    parts = [_states(segment, epoch_us) for segment in segments]
    for before, after, segment in zip(parts, parts[1:], segments[1:], strict=False):
        if not before[0][-1] == after[0][0]:
            raise BadFileError(
                f"line {segment.line}: this segment does not start when the one before it ends;"
                " split the file or make them meet"
            )
    time, position, velocity = (np.concatenate(columns) for columns in zip(*parts, strict=True))
    run = np.repeat(np.arange(len(parts)), [len(part[0]) for part in parts])
    lines = [line for segment in segments for line in segment.lines]
    burns_s = np.array([_useable_s(segments, epoch_us, time)])
    notes = (
        ("covariances are not read",) if any(segment.has_covariance for segment in segments) else ()
    )
    return StateTable(
        time,
        position,
        velocity,
        run,
        burns_s,
        lines.__getitem__,
        notes,
        has_dates=True,
        frame=_frame_text(segments[0]),
    )


def _frame_text(segment: Segment) -> str:
    """Return frame and time system, for `opir import`."""
    meta = segment.meta
    frozen = f" of {meta['REF_FRAME_EPOCH']}" if meta.get("REF_FRAME_EPOCH") else ""
    return f"{meta['REF_FRAME']}{frozen}, times in {meta['TIME_SYSTEM']}"


def segments_of_text(text: str) -> list[Segment]:
    """Return the segments of a message in the keyword form; raises `BadFileError`."""
    segments = list[Segment]()
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
    if block:
        raise BadFileError(f"ends within a block that began with {block}")
    if not segments:
        raise BadFileError("has no META_START, so no states")
    return segments


def _require_none(block: str, number: int) -> None:
    if block:
        raise BadFileError(f"line {number}: begins a block within one that began with {block}")


def require_meta(segments: list[Segment], number: int) -> None:
    """Raise `BadFileError` where the metadata of the last segment lack something, or are of what is
    not read.
    """
    if not segments:
        raise BadFileError(f"line {number}: ends a block that never began")
    meta = segments[-1].meta
    missing = [key for key in _NEEDED if not meta.get(key)]
    if missing:
        raise BadFileError(f"line {number}: the metadata lack {', '.join(missing)}")
    if meta["CENTER_NAME"].upper() != "EARTH":
        raise BadFileError(
            f"line {number}: CENTER_NAME is {meta['CENTER_NAME']!r}; only EARTH is taken"
        )
    if meta["TIME_SYSTEM"].upper() not in SYSTEMS:
        words = (
            f"TIME_SYSTEM is {meta['TIME_SYSTEM']!r}; convert the times to one of"
            f" {', '.join(SYSTEMS)}"
        )
        raise BadFileError(f"line {number}: {words}")
    if not frame_of(meta["REF_FRAME"]):
        known = ", ".join(FRAME_NAMES)
        raise BadFileError(
            f"line {number}: REF_FRAME is {meta['REF_FRAME']!r}; convert the states to one of"
            f" {known}"
        )
    if is_of_epoch(meta["REF_FRAME"]) and not meta.get("REF_FRAME_EPOCH"):
        raise BadFileError(
            f"line {number}: REF_FRAME is {meta['REF_FRAME']!r} and REF_FRAME_EPOCH is missing"
        )


def _state(words: list[str], number: int, system: str) -> list[float]:
    """Return a line's time, s since 1970, and state, km and km/s; accelerations are left."""
    if len(words) not in (7, 10):
        raise BadFileError(
            f"line {number}: has {len(words)} values; a state has a time and 6 (or 9) numbers"
        )
    numbers = []
    for word in words[1:]:
        try:
            numbers.append(float(word))
        except ValueError:
            numbers.append(math.nan)
        if not math.isfinite(numbers[-1]):
            raise BadFileError(f"line {number}: {word!r} is not a finite number")
    return [unix_s(words[0], number, system), *numbers[:6]]


def _of_object(segments: list[Segment], wanted: str | None) -> list[Segment]:
    names = list(dict.fromkeys(segment.meta["OBJECT_NAME"] for segment in segments))
    found = [
        s
        for s in segments
        if wanted is None or wanted in (s.meta["OBJECT_NAME"], s.meta["OBJECT_ID"])
    ]
    if not found:
        raise BadFileError(f"has no object {wanted!r}; it has {', '.join(names)}")
    if len({segment.meta["OBJECT_NAME"] for segment in found}) > 1:
        raise BadFileError(f"has several objects; say which with object: {', '.join(names)}")
    return found


def _states(segment: Segment, epoch_us: int) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return scene times, s, and states in ECEF, m and m/s."""
    if len(segment.states) < 2:
        raise BadFileError(f"line {segment.line}: this segment has fewer than 2 states")
    rows = np.array(segment.states)
    time_s = rows[:, 0] - epoch_us * 1e-6
    require_order(time_s, segment.lines.__getitem__, may_repeat=False)
    with np.errstate(over="ignore"):
        rows[:, 1:] *= 1e3
    require_places(rows[:, 1:4], segment.lines.__getitem__)
    require_velocities(rows[:, 4:7], segment.lines.__getitem__)
    text = segment.meta.get("REF_FRAME_EPOCH")
    system = segment.meta["TIME_SYSTEM"].upper()
    frame_s = unix_s(text, segment.line, system) - epoch_us * 1e-6 if text else None
    frame = frame_of(segment.meta["REF_FRAME"])
    return time_s, *to_ecef(frame, rows[:, 1:4], rows[:, 4:7], epoch_us, time_s, frame_s)


def _useable_s(segments: list[Segment], epoch_us: int, time_s: np.ndarray) -> tuple[float, float]:
    """Return the first and last useable scene times of the message."""
    ends = []
    for segment, key, other in (
        (segments[0], "USEABLE_START_TIME", time_s[0]),
        (segments[-1], "USEABLE_STOP_TIME", time_s[-1]),
    ):
        text = segment.meta.get(key)
        system = segment.meta["TIME_SYSTEM"].upper()
        ends.append(
            float(other) if text is None else unix_s(text, segment.line, system) - epoch_us * 1e-6
        )
    return max(ends[0], float(time_s[0])), min(ends[1], float(time_s[-1]))
