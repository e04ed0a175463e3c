"""Times in other systems than UTC, to seconds of UTC since 1970."""

from datetime import datetime
from functools import cache

import numpy as np

from opir_core.plugin import BadFileError
from opir_readers.published import published

#: Time systems, by how much they are ahead of TAI, s. UT1 is within 0.9 s of UTC, and taken for it.
_AHEAD_OF_TAI_S = {"TAI": 0.0, "GPS": -19.0, "TT": 32.184, "TDB": 32.184}
UTC_SYSTEMS = ("UTC", "UT1")
SYSTEMS = (*UTC_SYSTEMS, *_AHEAD_OF_TAI_S)


@cache
def _leaps_s() -> list[int]:
    """Return the Unix times from which TAI is a second more ahead of UTC, s."""
    days = np.array(published("leap_seconds")["days"], dtype="datetime64[s]")
    return days.astype(np.int64).tolist()


def tai_less_utc_s(unix_s: float) -> float:
    """Return TAI less UTC at a time of UTC from 1972 on, seconds since 1970."""
    return 10.0 + sum(unix_s >= leap_s for leap_s in _leaps_s())


def utc_s(seconds: float, system: str) -> float:
    """Return seconds of UTC since 1970 of a time that a calendar in another system gives as seconds
    since 1970.

    >>> utc_s(1_775_044_837.0, "TAI")
    1775044800.0
    """
    if system in UTC_SYSTEMS:
        return seconds
    tai_s = seconds - _AHEAD_OF_TAI_S[system]
    # One pass is enough but within a second of a leap, where the second one settles it.
    guess_s = tai_s - tai_less_utc_s(tai_s)
    return tai_s - tai_less_utc_s(guess_s)


def unix_s(text: str, number: int, system: str = "UTC") -> float:
    """Return seconds of UTC since 1970 (no leap seconds) of YYYY-MM-DDThh:mm:ss.s or
    YYYY-DDDThh:mm:ss.s.

    `number` is the line of the text, for the `BadFileError` about what is no time.
    """
    minute, _, fraction = text.removesuffix("Z").partition(".")
    for form in ("%Y-%m-%dT%H:%M:%S", "%Y-%jT%H:%M:%S"):
        try:
            seconds = (datetime.strptime(minute, form) - datetime(1970, 1, 1)).total_seconds()
        except ValueError:
            continue
        if not fraction or (fraction.isascii() and fraction.isdecimal()):
            return utc_s(seconds, system) + float(f"0.{fraction or 0}")
    raise BadFileError(
        f"line {number}: {text!r} is no time like 2026-04-01T12:00:00.000 (a leap second is none"
        " here)"
    )
