"""Lines of JSON put together from pieces: text that many events share made once, the rest a column at a time."""

from collections.abc import Iterable, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from opir_core.arrays import FloatArray, IntArray
from opir_core.events.identifiers import uuid_characters
from opir_core.events.timestamps import timestamp_characters, unix_microseconds
from opir_core.records import Detections, Window

#: A piece of the line: one for all events, or one for each.
Piece = bytes | list[bytes]

_ID_LENGTH, _TIMESTAMP_LENGTH = 36, 27


def joined_lines(count: int, pieces: Sequence[Piece]) -> bytes:
    """Return `count` lines of the pieces, one after the other."""
    line: list[bytes] = [b""] * (count * len(pieces))
    for place, piece in enumerate(pieces):
        line[place :: len(pieces)] = [piece] * count if isinstance(piece, bytes) else piece
    return b"".join(line)


def piece_table(pieces: Iterable[bytes]) -> NDArray[Any]:
    """Return pieces as an array to take from: an index array takes faster than a loop."""
    return np.array(list(pieces), dtype=object)


def taken(table: NDArray[Any], rows: NDArray[Any]) -> list[bytes]:
    """Return the pieces of a table's rows."""
    pieces: list[bytes] = table.take(rows).tolist()
    return pieces


def openings(detections: Detections, epoch_us: int, before_id: bytes, before_time: bytes) -> list[bytes]:
    """Return the beginnings of the lines: text, the id, text, the time, and a quotation mark with a comma."""
    blank = before_id + b"-" * _ID_LENGTH + before_time + b"-" * _TIMESTAMP_LENGTH + b'",'
    text = np.empty((len(detections), len(blank)), dtype=np.uint8)
    text[:] = np.frombuffer(blank, dtype=np.uint8)
    text[:, len(before_id) : len(before_id) + _ID_LENGTH] = uuid_characters(detections.detection_id)
    time_at = len(before_id) + _ID_LENGTH + len(before_time)
    times = timestamp_characters(unix_microseconds(detections.time_ns, epoch_us))
    text[:, time_at : time_at + _TIMESTAMP_LENGTH] = times
    pieces: list[bytes] = text.view(f"S{len(blank)}").ravel().tolist()
    return pieces


@np.errstate(invalid="ignore", over="ignore")
def carried_positions(window: Window, rows: IntArray) -> FloatArray:
    """Return ECEF positions of the estimates of some detections, carried from their tick at constant velocity."""
    estimate = window.detections.estimate[rows]
    state = window.estimates.state[estimate]
    since_tick_s = window.detections.time_s[rows] - window.estimates.tick_s[estimate]
    carried: FloatArray = state[:, :3] + since_tick_s[:, np.newaxis] * state[:, 3:]
    return carried
