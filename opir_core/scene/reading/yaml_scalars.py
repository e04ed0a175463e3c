"""The scene's zero of time: RFC 3339 text to microseconds of UTC, and back, by whole numbers.

What an unquoted scalar means, by rules on which no two readers of YAML differ.

YAML 1.1 and 1.2 (and their readers) disagree about `010`, `0o10`, `1_000`, `12:30:00`, `1e3` and `no`. Here a number is
decimal (`42`, `-0.5`, `1e3`), and what some reader would take for another number is refused with the way out.
"""

import math
import re
from datetime import UTC, datetime, timedelta
from typing import Any

from opir_core.scene.reading.limits import MAXIMUM_DIGITS
from opir_core.scene.reading.nodes import SwitchWord, unprintable_complaint

_CONSTANTS = {
    **dict.fromkeys(("", "~", "null", "Null", "NULL"), None),
    **dict.fromkeys(("true", "True", "TRUE"), True),
    **dict.fromkeys(("false", "False", "FALSE"), False),
}
_SWITCHES = {case(word): on for word, on in (("yes", True), ("no", False), ("on", True), ("off", False))
             for case in (str.lower, str.capitalize, str.upper)}  # fmt: skip
_FIRST_OF_NUMBER = frozenset("0123456789+-.")

_WHOLE = re.compile(r"[-+]?(0|[1-9][0-9]*)")
_DECIMAL = re.compile(r"[-+]?((0|[1-9][0-9]*)(\.[0-9]*)?|\.[0-9]+)([eE][-+]?[0-9]+)?")
_ODD = (
    (re.compile(r"[-+]?\.(inf|Inf|INF|nan|NaN|NAN)"), "{0} is not a finite number"),
    (
        re.compile(r"[-+]?[0-9][0-9_]*(:[0-9]+)+(\.[0-9_]*)?"),
        "{0} is a number in base 60 to some YAML readers; write a decimal number, or '{0}' in quotes for text",
    ),
    (
        re.compile(r"[-+]?0[xXoObB][0-9a-fA-F_]+"),
        "{0} is not a decimal number; write one, or '{0}' in quotes for text",
    ),
    (
        re.compile(r"[-+]?[0-9][0-9_]*_[0-9_]*(\.[0-9_]*)?([eE][-+]?[0-9]+)?|[-+]?[0-9]+\.[0-9_]*_[0-9_]*"),
        "{0} has '_' between digits; leave it out, or write '{0}' in quotes for text",
    ),
    (
        re.compile(r"[-+]?0[0-9]+(\.[0-9]*)?([eE][-+]?[0-9]+)?"),
        "{0} begins with a zero, which is octal to some YAML readers; leave it out, or write '{0}' in quotes for text",
    ),
)


def plain_value(text: str) -> Any:
    """Return what an unquoted scalar means: None, a truth value, an int, a float, a `SwitchWord` or text.

    Raises `ValueError`, with words for the user, where that depends on who reads it or would not keep the number.
    """
    if text in _CONSTANTS:
        return _CONSTANTS[text]
    if text[0] in _FIRST_OF_NUMBER:
        return _number_or_text(text)
    return SwitchWord(text) if text in _SWITCHES else quoted_value(text)


def quoted_value(text: str) -> str:
    """Return a text as it is; raises `ValueError` where it holds what is not text."""
    complaint = unprintable_complaint(text)
    if complaint:
        raise ValueError(complaint)
    return text


def is_on(word: SwitchWord) -> bool:
    """Return the truth value of a switch word."""
    return _SWITCHES[word]


def is_decimal_text(text: str) -> bool:
    """Return whether a text would be a number without its quotes."""
    return _DECIMAL.fullmatch(text) is not None


def _number_or_text(text: str) -> int | float | str:
    if _WHOLE.fullmatch(text):
        return _whole(text)
    if _DECIMAL.fullmatch(text):
        return _decimal(text)
    for pattern, complaint in _ODD:
        if pattern.fullmatch(text):
            raise ValueError(complaint.format(text if len(text) <= MAXIMUM_DIGITS else f"{text[:MAXIMUM_DIGITS]}..."))
    return quoted_value(text)


def _whole(text: str) -> int:
    digits = len(text.lstrip("+-"))
    if digits > MAXIMUM_DIGITS:
        raise ValueError(f"a whole number of {digits} digits; at most {MAXIMUM_DIGITS} are read")
    return int(text)


def _decimal(text: str) -> float:
    number = float(text)
    short = text if len(text) <= MAXIMUM_DIGITS else f"{text[:MAXIMUM_DIGITS]}..."
    if math.isinf(number):
        raise ValueError(f"{short} is too large for a number; the largest is about 1.8e308")
    if number == 0.0 and re.search("[1-9]", re.split("[eE]", text)[0]):
        raise ValueError(f"{short} is too small for a number and would be read as 0")
    return number


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
