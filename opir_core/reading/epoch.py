"""The scene's zero of time: RFC 3339 text to microseconds of UTC, and back, by whole numbers."""

import re
from datetime import UTC, datetime, timedelta

_FIRST_YEAR, _LAST_YEAR = 1970, 2099
_START = datetime(1970, 1, 1, tzinfo=UTC)
_MICROSECOND = timedelta(microseconds=1)
_FORM = re.compile(r"(\d{4})-(\d{2})-(\d{2})T(\d{2}):(\d{2}):(\d{2})(?:\.(\d+))?(Z|[-+]\d{2}:\d{2})?", re.ASCII)
_EXAMPLE = "2026-04-01T12:00:00Z"


def epoch_us_of_text(text: str) -> int:
    """Return microseconds since 1970-01-01 UTC (no leap seconds) of `YYYY-MM-DDThh:mm:ss[.ffffff]Z`.

    Raises `ValueError`, with words for the user, for any other form, for a moment that does not exist (a leap second is
    none here) and for years outside 1970 to 2099.
    """
    found = _FORM.fullmatch(text)
    if found is None:
        raise ValueError(f"{text!r} is not a time; write it like {_EXAMPLE}")
    *whole, fraction, zone = found.groups()
    if zone != "Z":
        raise ValueError(f"{text!r} is not in UTC; write the time in UTC, ended by Z, like {_EXAMPLE}")
    if fraction and len(fraction) > 6:
        raise ValueError(f"{text!r} is finer than a microsecond")
    try:
        moment = datetime(*(int(part) for part in whole), tzinfo=UTC)  # type: ignore[misc,arg-type]
    except ValueError as error:
        raise ValueError(f"{text!r} is not a time that exists") from error
    if not _FIRST_YEAR <= moment.year <= _LAST_YEAR:
        raise ValueError(f"{text!r} is outside the years {_FIRST_YEAR} to {_LAST_YEAR}")
    return (moment - _START) // _MICROSECOND + int((fraction or "").ljust(6, "0"))


def text_of_epoch_us(epoch_us: int) -> str:
    """Return `YYYY-MM-DDThh:mm:ss[.ffffff]Z` for microseconds since 1970-01-01 UTC."""
    moment = _START + epoch_us * _MICROSECOND
    return f"{moment:%Y-%m-%dT%H:%M:%S}{f'.{moment.microsecond:06d}' if moment.microsecond else ''}Z"
