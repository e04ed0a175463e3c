"""Times in other systems than UTC, to seconds of UTC since 1970."""

from datetime import datetime, timedelta

from opir_core.plugin import BadFileError

_UNIX = datetime(1970, 1, 1)

#: TAI less UTC at 1972-01-01, s, and the days from which it is a second more (IERS Bulletin C 70).
_FIRST_S = 10.0
_LEAP_DAYS = (
    *(
        "1972-07-01",
        "1973-01-01",
        "1974-01-01",
        "1975-01-01",
        "1976-01-01",
        "1977-01-01",
        "1978-01-01",
        "1979-01-01",
    ),
    *(
        "1980-01-01",
        "1981-07-01",
        "1982-07-01",
        "1983-07-01",
        "1985-07-01",
        "1988-01-01",
        "1990-01-01",
        "1991-01-01",
    ),
    *(
        "1992-07-01",
        "1993-07-01",
        "1994-07-01",
        "1996-01-01",
        "1997-07-01",
        "1999-01-01",
        "2006-01-01",
        "2009-01-01",
    ),
    *("2012-07-01", "2015-07-01", "2017-01-01"),
)
_LEAPS_S = tuple(
    (datetime.fromisoformat(day) - _UNIX) // timedelta(seconds=1) for day in _LEAP_DAYS
)

#: Time systems, by how much they are ahead of TAI, s. UT1 is within 0.9 s of UTC, and taken for it.
_AHEAD_OF_TAI_S = {"TAI": 0.0, "GPS": -19.0, "TT": 32.184, "TDB": 32.184}
UTC_SYSTEMS = ("UTC", "UT1")
SYSTEMS = (*UTC_SYSTEMS, *_AHEAD_OF_TAI_S)


def tai_less_utc_s(unix_s: float) -> float:
    """Return TAI less UTC at a time of UTC from 1972 on, seconds since 1970."""
    return _FIRST_S + sum(unix_s >= leap_s for leap_s in _LEAPS_S)


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
    whole, _, fraction = text.removesuffix("Z").partition(".")
    for form in ("%Y-%m-%dT%H:%M:%S", "%Y-%jT%H:%M:%S"):
        try:
            seconds = (datetime.strptime(whole, form) - _UNIX) // timedelta(seconds=1)
        except ValueError:
            continue
        if not fraction or (fraction.isascii() and fraction.isdecimal()):
            return utc_s(float(seconds), system) + float(f"0.{fraction or 0}")
    raise BadFileError(
        f"line {number}: {text!r} is no time like 2026-04-01T12:00:00.000 (a leap second is none"
        f" here)"
    )
