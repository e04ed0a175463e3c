"""Times of detections: dates in UTC, to the nanosecond."""

import re

import numpy as np

from opir_core.plugin import BadFileError
from opir_readers.detections.numbers import shown

_TIME = r"(?P<clock>\d\d:\d\d(:\d\d)?([.,]\d{1,12})?)\s*(?P<zone>(Z|UTC|[+-]\d\d:?\d\d)?)"
_DATE = re.compile(
    r"(\d{4}-\d\d-\d\d|\d{4}-\d{3})[T ](\d\d:\d\d)(:\d\d)?([.,]\d{1,12})?\s*(Z|UTC|[+-]\d\d:?\d\d)?",
    re.I,
)

#: Other ways to write a date, by the fields that they name: 01 Apr 2026, 2026/04/01,
#: 20260401T120000, 2026/091/12:00, 2026:091:12:00; with points the day comes first.
_WAYS = tuple(
    re.compile(pattern + _TIME, re.I)
    for pattern in (
        r"(?P<day>\d{1,2})[ -](?P<word>[a-z]{3,9})[ -](?P<year>\d{4}) ",
        r"(?P<year>\d{4})[ -](?P<word>[a-z]{3})[ -](?P<day>\d\d) ",
        r"(?P<year>\d{4})/(?P<month>\d\d?)/(?P<day>\d\d?)[T ]",
        r"(?P<day>\d\d?)\.(?P<month>\d\d?)\.(?P<year>\d{4})[T ]",
        r"(?P<year>\d{4})[/:](?P<of_year>\d{3})[/:T ]",
    )
)
_BASIC = re.compile(r"(\d{4})(\d\d)(\d\d)T(\d\d)(\d\d)(\d\d)?(.*)", re.I)

#: Day and month, or month and day: only the writer knows.
_AMBIGUOUS = re.compile(r"\d{1,2}/\d{1,2}/\d{2,4}\b.*")
_LIKE = re.compile(r"\d{4}-\d\d?-\d\d?\b.*")
_MONTHS = ("jan", "feb", "mar", "apr", "may", "jun", "jul", "aug", "sep", "oct", "nov", "dec")
NS_PER_S = 1_000_000_000


def unix_ns(value: object, subject: str) -> int:
    """Return nanoseconds of UTC since 1970 (no leap seconds) of a date, `2026-04-01T12:00:00.123Z`.

    The day may be that of the year, `2026-091`; a comma may stand before decimals. A date without
    zone is in UTC. `subject` begins
    the message of the `BadFileError` about another value.
    """
    match = _match(value.strip()) if isinstance(value, str) else None
    if match is None:
        is_ambiguous = isinstance(value, str) and _AMBIGUOUS.fullmatch(value.strip())
        why = ": it may be day/month or month/day" if is_ambiguous else ""
        raise BadFileError(
            f"{subject} is {shown(value)}, no date like 2026-04-01T12:00:00.123Z{why}"
        )
    day, minute, second, fraction, zone = match.groups()
    try:
        moment = _day(day) + np.timedelta64(_seconds(minute, second), "s")
    except ValueError:
        raise BadFileError(
            f"{subject} is {shown(value)}, a date that no calendar has (leap seconds are none here)"
        ) from None
    decimals = (fraction or ".")[1:].ljust(9, "0")[:9]
    since_s = int(moment.astype(np.int64)) - _offset_s(zone or "Z")
    if not abs(since_s) < 2**33:
        raise BadFileError(f"{subject} is {shown(value)}, a date that is centuries away")
    return since_s * NS_PER_S + int(decimals)


def looks_like_date(text: str) -> bool:
    """Whether a text is a date that is read, or one that is refused as a date.

    >>> looks_like_date("01 Apr 2026 12:00:00"), looks_like_date("04/01/2026"), looks_like_date("12.5")
    (True, True, False)
    """
    bare = text.strip()
    return _match(bare) is not None or any(kind.fullmatch(bare) for kind in (_AMBIGUOUS, _LIKE))


def _match(text: str) -> re.Match[str] | None:
    return _DATE.fullmatch(text) or _DATE.fullmatch(_in_digits(text))


def _in_digits(text: str) -> str:
    """Return `01 Apr 2026 12:00:00` as `2026-04-01T12:00:00`, and so other ways to write it; else
    the text as it is.
    """
    basic = _BASIC.fullmatch(text)
    if basic:
        year, month, day, hour, minute, second, zone = basic.groups("00")
        return f"{year}-{month}-{day}T{hour}:{minute}:{second}{zone}"
    match = next(filter(None, (form.fullmatch(text) for form in _WAYS)), None)
    if match is None:
        return text
    fields = match.groupdict()
    word = fields.get("word", "jan")[:3].lower()
    if word not in _MONTHS:
        return text
    number = int(fields.get("month") or _MONTHS.index(word) + 1)
    of_year = fields["of_year"] if "of_year" in fields else f"{number:02d}-{int(fields['day']):02d}"
    return f"{fields['year']}-{of_year}T{fields['clock']}{fields['zone']}"


def _day(text: str) -> np.datetime64:
    if len(text) == 10:
        return np.datetime64(text, "s")
    year, day = text.split("-")
    if not 1 <= int(day) <= 366:
        raise ValueError
    return np.datetime64(year, "s") + np.timedelta64(int(day) - 1, "D")


def _seconds(minute: str, second: str | None) -> int:
    hours = int(minute[:2])
    minutes = int(minute[3:])
    seconds = int((second or ":0")[1:])
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
