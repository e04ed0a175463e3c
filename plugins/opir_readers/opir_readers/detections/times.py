"""Times of detections: dates in UTC, to the nanosecond."""

import re

import numpy as np

from opir_core.plugin import BadFileError
from opir_readers.detections.numbers import shown

_DATE = re.compile(r"(\d{4}-\d\d-\d\d|\d{4}-\d{3})[T ](\d\d:\d\d)(:\d\d)?(\.\d{1,12})?\s*(Z|UTC|[+-]\d\d:?\d\d)?", re.I)
_WORDS = re.compile(r"(\d{1,2}) ([A-Za-z]{3}) (\d{4}) (\d\d:\d\d:\d\d(\.\d{1,12})?)")
_MONTHS = ("jan", "feb", "mar", "apr", "may", "jun", "jul", "aug", "sep", "oct", "nov", "dec")
_NS = 1_000_000_000


def unix_ns(value: object, what: str) -> int:
    """Return nanoseconds of UTC since 1970 (no leap seconds) of a date, `2026-04-01T12:00:00.123Z`.

    The day may be that of the year, `2026-091`. A date without zone is in UTC. `what` begins the message of the
    `BadFileError` about what is no date.
    """
    match = _DATE.fullmatch(_in_digits(value.strip())) if isinstance(value, str) else None
    if match is None:
        raise BadFileError(f"{what} is {shown(value)}, no date like 2026-04-01T12:00:00.123Z")
    day, minute, second, fraction, zone = match.groups()
    try:
        moment = _day(day) + np.timedelta64(_seconds(minute, second), "s")
    except ValueError:
        raise BadFileError(
            f"{what} is {shown(value)}, a date that no calendar has (leap seconds are none here)"
        ) from None
    decimals = (fraction or ".")[1:].ljust(9, "0")[:9]
    since_s = int(moment.astype(np.int64)) - _offset_s(zone or "Z")
    if not abs(since_s) < 2**33:
        raise BadFileError(f"{what} is {shown(value)}, a date that is centuries away")
    return since_s * _NS + int(decimals)


def _in_digits(text: str) -> str:
    """Return `01 Apr 2026 12:00:00` as `2026-04-01T12:00:00`, other texts as they are."""
    match = _WORDS.fullmatch(text)
    if match is None or match[2].lower() not in _MONTHS:
        return text
    return f"{match[3]}-{_MONTHS.index(match[2].lower()) + 1:02d}-{int(match[1]):02d}T{match[4]}"


def _day(text: str) -> np.datetime64:
    if len(text) == 10:
        return np.datetime64(text, "s")
    year, day = text.split("-")
    if not 1 <= int(day) <= 366:
        raise ValueError
    return np.datetime64(year, "s") + np.timedelta64(int(day) - 1, "D")


def _seconds(minute: str, second: str | None) -> int:
    hours, minutes, seconds = int(minute[:2]), int(minute[3:]), int((second or ":0")[1:])
    if hours > 23 or minutes > 59 or seconds > 59:
        raise ValueError
    return 3600 * hours + 60 * minutes + seconds


def _offset_s(zone: str) -> int:
    if zone[0] not in "+-":
        return 0
    digits = zone[1:].replace(":", "")
    return (-1 if zone[0] == "-" else 1) * (3600 * int(digits[:2]) + 60 * int(digits[2:]))


def date_text(since_ns: int) -> str:
    """Return nanoseconds of UTC since 1970 as a date.

    >>> date_text(1_775_044_800_250_000_000)
    '2026-04-01T12:00:00.250000000Z'
    """
    return f"{np.datetime64(since_ns, 'ns')}Z"
