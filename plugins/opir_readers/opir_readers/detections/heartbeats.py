"""Heartbeats among events: which sensor watched from when to when, whatever it saw.

A consumer of a stream cannot know by silence alone whether a sensor saw nothing or is not there.
"""

from collections.abc import Iterator, Mapping, Sequence
from typing import Any

import numpy as np

from opir_core.arrays import FloatArray
from opir_core.errors import number_of
from opir_core.plugin import BadFileError
from opir_readers.detections.numbers import Row, Rows, finite, place_of
from opir_readers.detections.times import NS_PER_S, unix_ns

#: The value of `record` in a heartbeat.
HEARTBEAT = "heartbeat"

#: The key, in the first row of a file, of its heartbeats.
HEARTBEATS = "heartbeats"

Spans = tuple[tuple[float, float], ...]

#: Spans that lie no farther apart than this, s, are one: times of events have microseconds.
TOUCHING_S = 2e-6

#: A look lasts no time: the span of one alone, s.
LOOK_S = 1e-6


def is_heartbeat(value: Any) -> bool:
    """Return whether an object of a file is a heartbeat, and no detection."""
    return isinstance(value, dict) and value.get("record") == HEARTBEAT


def heartbeat_spans(
    rows: Rows, ids: Sequence[str], names: Mapping[str, str], epoch_us: int
) -> dict[str, Spans]:
    """Return the spans, s, that the heartbeats of a file say were watched, by sensor; none of a
    file without heartbeats.

    Raises `BadFileError` with the line of one that names no sensor of `ids`, or ends before it
    begins.
    """
    spans = dict[str, list[tuple[float, float]]]()
    for beat in rows[0].get(HEARTBEATS, ()) if rows else ():
        name = names.get(str(beat.get("sensor_id")), str(beat.get("sensor_id")))
        if name not in ids:
            raise BadFileError(f"{place_of(beat)}a heartbeat of {name!r}, no sensor of --sensors")
        start_s, end_s = (_time_s(beat, key, epoch_us) for key in ("watched_from", "watched_to"))
        if not start_s < end_s:
            raise BadFileError(f"{place_of(beat)}a heartbeat that ends before it begins")
        spans.setdefault(name, []).append((start_s, end_s))
    return {name: merged(of_sensor) for name, of_sensor in spans.items()}


def _time_s(beat: Row, key: str, epoch_us: int) -> float:
    """Return the scene time of a key, seconds or a date."""
    subject = f"{place_of(beat)}{key} of a heartbeat"
    value = beat.get(key)
    if isinstance(value, str):
        return (unix_ns(value, subject) - 1000 * epoch_us) / NS_PER_S
    return finite(value, subject)


def merged(spans: Sequence[tuple[float, float]]) -> Spans:
    """Return spans in order, those that touch or overlap as one: a stream may repeat itself.

    >>> merged([(5.0, 6.0), (0.0, 2.0), (2.0, 3.0), (1.0, 2.5)])
    ((0.0, 3.0), (5.0, 6.0))
    """
    result = list[tuple[float, float]]()
    for start_s, end_s in sorted(spans):
        if result and start_s <= result[-1][1] + TOUCHING_S:
            result[-1] = (result[-1][0], max(end_s, result[-1][1]))
        else:
            result.append((start_s, end_s))
    return tuple(result)


def with_detections(spans: Spans, time_s: FloatArray) -> tuple[Spans, FloatArray]:
    """Return the spans of a sensor with the instants (n,) of its detections, and those outside."""
    edges_s = np.ravel(spans)
    before = np.searchsorted(edges_s, time_s + TOUCHING_S, side="right")
    after = np.searchsorted(edges_s, time_s - TOUCHING_S, side="left")
    outside = time_s[(before % 2 == 0) & (after % 2 == 0)]
    looks = [(at_s, at_s + LOOK_S) for at_s in outside.tolist()]
    return merged([*spans, *looks]), outside


def contradictions(name: str, outside_s: FloatArray) -> Iterator[str]:
    """Yield a sentence on detections of a sensor outside of its heartbeats, if there are any."""
    if len(outside_s):
        yield (
            f"{number_of('detection', len(outside_s))} of {name}, the first at"
            f" {outside_s.min():.3f} s, lie outside of what its heartbeats say it watched: they are"
            " kept"
        )
