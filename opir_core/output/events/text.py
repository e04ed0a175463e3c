"""Columns of events as JSON text: RFC 3339 timestamps (UTC, microseconds, `Z`) and numbers."""

from collections.abc import Iterable
from typing import Any

import msgspec
import numpy as np

from opir_core.arrays import BoolArray, ByteArray, FloatArray, IntArray
from opir_core.errors import SinkError
from opir_core.interfaces.records import Window

#: Years of RFC 3339, 1 to 9999, in µs since 1970-01-01: the first microsecond, and the first after
#: the last.
FIRST_UNIX_US = -62_135_596_800_000_000
END_UNIX_US = 253_402_300_800_000_000

_NS_PER_US = 1_000
_US_PER_S = 1_000_000
_TO_SECONDS = 19
_TEXT_LENGTH = 27
_POINT = ord(".")
_ZULU = ord("Z")
_ZERO = np.uint32(ord("0"))
_TEN = np.uint32(10)


def unix_microseconds(time_ns: IntArray, epoch_us: int) -> IntArray:
    """Return scene times (n,), ns since the epoch, as µs of UTC since 1970-01-01, rounded half up.

    `epoch_us` is the epoch, in µs since 1970-01-01 without leap seconds.
    """
    microseconds, remainder_ns = np.divmod(time_ns, _NS_PER_US)
    return microseconds + (2 * remainder_ns >= _NS_PER_US) + epoch_us


def writable_unix_microseconds(time_s: FloatArray, epoch_us: int) -> tuple[IntArray, BoolArray]:
    """Return scene times (n,), s, as µs since 1970-01-01, and which are finite and in the years 1
    to 9999.

    The others are the epoch.
    """
    earliest_s = (FIRST_UNIX_US - epoch_us) / _US_PER_S
    latest_s = (END_UNIX_US - epoch_us) / _US_PER_S
    writable = (time_s > earliest_s) & (time_s < latest_s)
    unix_us = np.rint(np.where(writable, time_s, 0.0) * _US_PER_S).astype(np.int64) + epoch_us
    return unix_us, writable & (unix_us >= FIRST_UNIX_US) & (unix_us < END_UNIX_US)


def timestamp_text(unix_us: IntArray) -> list[str]:
    """Return times (n,), µs since 1970-01-01, as text such as `2026-04-01T12:00:00.050000Z`.

    A time outside the years 1 to 9999 raises `SinkError`.
    """
    text = timestamp_characters(unix_us).tobytes().decode("ascii")
    return [text[start : start + _TEXT_LENGTH] for start in range(0, len(text), _TEXT_LENGTH)]


def timestamp_characters(unix_us: IntArray) -> ByteArray:
    """Return times (n,), µs since 1970-01-01, as ASCII codes (n, 27); errors as
    `timestamp_text`.
    """
    refuse_unwritable(unix_us)
    seconds, microseconds = np.divmod(unix_us, _US_PER_S)
    text = np.empty((len(unix_us), _TEXT_LENGTH), dtype=np.uint8)
    text[:, :_TO_SECONDS] = _second_characters(seconds)
    text[:, _TO_SECONDS] = _POINT
    text[:, -1] = _ZULU
    quotient = microseconds.astype(np.uint32)
    for place in range(_TEXT_LENGTH - 2, _TO_SECONDS, -1):
        tens = quotient // _TEN
        text[:, place] = quotient - tens * _TEN + _ZERO
        quotient = tens
    return text


def _second_characters(seconds: IntArray) -> ByteArray:
    """Return whole seconds (n,) as ASCII codes (n, 19); equal neighbours are converted once."""
    is_new = np.diff(seconds, prepend=seconds[:1] - 1) != 0
    text = np.datetime_as_string(seconds[is_new].astype("M8[s]")).astype(f"S{_TO_SECONDS}")
    characters = text.view(np.uint8).reshape(-1, _TO_SECONDS)
    return np.take(characters, np.cumsum(is_new) - 1, axis=0)


def refuse_unwritable(unix_us: IntArray) -> None:
    """Raise `SinkError` if times (n,), µs since 1970-01-01, lie outside the years 1 to 9999."""
    outside = np.count_nonzero((unix_us < FIRST_UNIX_US) | (unix_us >= END_UNIX_US))
    if outside:
        raise SinkError(
            f"{outside} of {len(unix_us)} times lie outside the years 1 to 9999, the range of"
            f" timestamps;"
            " give the scene another epoch"
        )


#: Decimals: angles to 1e-9 deg (0.1 mm on the ground), lengths to the millimetre, ratios to 1e-6.
DEGREE_DECIMALS = 9
METRE_DECIMALS = 3
RATIO_DECIMALS = 6

#: Decimals of the event `forge`, far below the errors of what they tell: points to 1e-4 deg (11 m),
#: probabilities to 1e-4, and ratios of signal to noise, whose standard deviation is 1, to 0.01.
POINT_DECIMALS = 4
SHARE_DECIMALS = 4
SNR_DECIMALS = 2

#: Significant digits of the standard deviations of lines of sight.
SIGMA_DIGITS = 4

#: Significant digits of irradiances, which span many orders of magnitude.
IRRADIANCE_DIGITS = 6

#: Magnitudes that are rounded to significant digits.
_LEAST = 1e-290
_MOST = 1e290

# From here on doubles are integers.
_ALL_WHOLE = 2.0**52

_encode = msgspec.json.Encoder().encode


def rounded(values: FloatArray, decimals: int) -> FloatArray:
    """Return values rounded to decimals, element by element; never -0; nan and inf unchanged."""
    scale = 10.0**decimals
    has_decimals = np.abs(values) < _ALL_WHOLE / scale
    return (
        np.where(has_decimals, np.rint(np.where(has_decimals, values, 0.0) * scale) / scale, values)
        + 0.0
    )


def significant(values: FloatArray, digits: int) -> FloatArray:
    """Return values rounded to significant digits, element by element; never -0; nan and inf
    unchanged.

    Magnitudes below 1e-290 become 0, those above 1e290 are unchanged: there powers of ten leave the
    range of doubles.
    """
    size = np.abs(values)
    in_range = (size >= _LEAST) & (size <= _MOST)
    regular = np.where(in_range, values, 1.0)
    places = digits - 1 - np.floor(np.log10(np.abs(regular)))
    # Powers of ten up to the 22nd are exact doubles: the texts then have no more than these digits.
    up = 10.0 ** np.maximum(places, 0.0)
    down = 10.0 ** np.maximum(-places, 0.0)
    nearest = np.rint(regular * up / down) * down / up
    return np.where(in_range, nearest, np.where(size < _LEAST, 0.0, values)) + 0.0


def rounded_number(value: float, decimals: int) -> float:
    """Return one number, rounded as in `rounded`."""
    return float(rounded(np.array([value]), decimals)[0])


def rounded_degrees(angle_rad: FloatArray, decimals: int = DEGREE_DECIMALS) -> FloatArray:
    """Return angles, rad, in degrees, rounded."""
    return rounded(np.degrees(angle_rad), decimals)


def rounded_bearing_deg(
    angle_rad: FloatArray, turn_deg: float = 360.0, decimals: int = DEGREE_DECIMALS
) -> FloatArray:
    """Return angles, rad, as degrees in [0, turn), rounded."""
    bearing = np.degrees(angle_rad)
    if not np.all(
        (bearing >= 0.0) & (bearing < turn_deg)
    ):  # np.mod changes no other value, but takes time.
        bearing = np.mod(bearing, turn_deg)
    bearing = rounded(bearing, decimals)
    return np.where(bearing == turn_deg, 0.0, bearing)


def rounded_longitude_deg(longitude_rad: FloatArray, decimals: int = DEGREE_DECIMALS) -> FloatArray:
    """Return longitudes, rad, as degrees in [-180, 180), rounded."""
    east = rounded_bearing_deg(longitude_rad, decimals=decimals)
    return np.where(east >= 180.0, rounded(east - 360.0, decimals), east)


def are_finite(values: FloatArray) -> BoolArray:
    """Return which rows (n, ...) are finite throughout."""
    return np.logical_and.reduce(np.isfinite(values), axis=tuple(range(1, values.ndim)))


def where_known(rows: Iterable[Any], is_known: BoolArray) -> list[Any]:
    """Return rows (n,), None where they are not known (n,)."""
    if is_known.all():
        return list(rows)
    return [
        row if has_value else None for row, has_value in zip(rows, is_known.tolist(), strict=True)
    ]


def known_rows(values: FloatArray) -> list[Any]:
    """Return the rows of a column as plain values, None where any number is not finite."""
    return where_known(values.tolist(), are_finite(values))


def number_texts(values: FloatArray) -> list[bytes]:
    """Return numbers (n,) as JSON: the shortest text of the same double; nan and inf are `null`."""
    return _encode(values.tolist())[1:-1].split(b",") if len(values) else []


def vector_texts(vectors: FloatArray) -> list[bytes]:
    """Return the components of vectors (n, m) as in `number_texts`, joined by commas."""
    return _encode(vectors.tolist())[2:-2].split(b"],[") if len(vectors) else []


@np.errstate(invalid="ignore", over="ignore")
def propagated_positions(window: Window, rows: IntArray) -> FloatArray:
    """Return the ECEF positions, m, of the estimates of some detections, propagated at constant
    velocity.
    """
    estimate = window.detections.estimate[rows]
    state = window.estimates.state[estimate]
    since_tick_s = window.detections.time_s[rows] - window.estimates.tick_s[estimate]
    return state[:, :3] + since_tick_s[:, np.newaxis] * state[:, 3:]
