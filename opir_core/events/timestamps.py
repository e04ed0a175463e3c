"""Timestamps in bulk: RFC 3339, UTC, microseconds, `Z`."""

import numpy as np
from numpy.typing import NDArray

from opir_core.arrays import FloatArray, IntArray
from opir_core.errors import SinkError

#: The years that RFC 3339 can write, 1 to 9999, in µs since 1970-01-01: the first microsecond, and the first after.
FIRST_UNIX_US = -62_135_596_800_000_000
END_UNIX_US = 253_402_300_800_000_000

_NS_PER_US = 1_000
_US_PER_S = 1_000_000
_TO_SECONDS, _TEXT_LENGTH = 19, 27
_POINT, _ZULU, _ZERO = ord("."), ord("Z"), np.uint32(ord("0"))
_TEN = np.uint32(10)


def unix_microseconds(time_ns: IntArray, epoch_us: int) -> IntArray:
    """Return scene times (n,), ns since the epoch, as µs of UTC since 1970-01-01: the nearest, halves later.

    `epoch_us` is the epoch, in µs since 1970-01-01 without leap seconds.
    """
    whole, rest = np.divmod(time_ns, _NS_PER_US)
    rounded: IntArray = whole + (2 * rest >= _NS_PER_US) + epoch_us
    return rounded


def writable_unix_microseconds(time_s: FloatArray, epoch_us: int) -> tuple[IntArray, NDArray[np.bool_]]:
    """Return scene times (n,), s, as µs since 1970-01-01, and which of them are known and in the years 1 to 9999.

    The others are given as the epoch.
    """
    earliest_s, latest_s = (FIRST_UNIX_US - epoch_us) / _US_PER_S, (END_UNIX_US - epoch_us) / _US_PER_S
    writable = (time_s > earliest_s) & (time_s < latest_s)
    unix_us = np.rint(np.where(writable, time_s, 0.0) * _US_PER_S).astype(np.int64) + epoch_us
    return unix_us, writable & (unix_us >= FIRST_UNIX_US) & (unix_us < END_UNIX_US)


def timestamp_text(unix_us: IntArray) -> list[str]:
    """Return times (n,), µs since 1970-01-01, as text such as `2026-04-01T12:00:00.050000Z`.

    A time outside the years 1 to 9999 raises `SinkError`.
    """
    text = timestamp_characters(unix_us).tobytes().decode("ascii")
    return [text[start : start + _TEXT_LENGTH] for start in range(0, len(text), _TEXT_LENGTH)]


def timestamp_characters(unix_us: IntArray) -> NDArray[np.uint8]:
    """Return times (n,), µs since 1970-01-01, as ASCII codes (n, 27); errors as `timestamp_text`."""
    _refuse_unwritable(unix_us)
    seconds, microseconds = np.divmod(unix_us, _US_PER_S)
    text = np.empty((len(unix_us), _TEXT_LENGTH), dtype=np.uint8)
    text[:, :_TO_SECONDS] = _second_characters(seconds)
    text[:, _TO_SECONDS] = _POINT
    text[:, -1] = _ZULU
    rest = microseconds.astype(np.uint32)
    for place in range(_TEXT_LENGTH - 2, _TO_SECONDS, -1):
        tens = rest // _TEN
        text[:, place] = rest - tens * _TEN + _ZERO
        rest = tens
    return text


def _second_characters(seconds: IntArray) -> NDArray[np.uint8]:
    """Return whole seconds (n,) as ASCII codes (n, 19); equal neighbours, as in sorted times, are written once."""
    is_new = np.diff(seconds, prepend=seconds[:1] - 1) != 0
    text = np.datetime_as_string(seconds[is_new].astype("M8[s]")).astype(f"S{_TO_SECONDS}")
    characters = text.view(np.uint8).reshape(-1, _TO_SECONDS)
    repeated: NDArray[np.uint8] = np.take(characters, np.cumsum(is_new) - 1, axis=0)
    return repeated


def _refuse_unwritable(unix_us: IntArray) -> None:
    outside = np.count_nonzero((unix_us < FIRST_UNIX_US) | (unix_us >= END_UNIX_US))
    if outside:
        raise SinkError(
            f"{outside} of {len(unix_us)} times lie outside the years 1 to 9999, which a timestamp cannot say;"
            " give the scene another epoch"
        )
