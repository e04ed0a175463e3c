"""Published mean elements for SGP4: what a two-line element set or an Orbit Mean-Elements Message must hold.

Sources: Hoots and Roehrich, Spacetrack Report No. 3 (1980), for the columns of a TLE; CCSDS 502.0-B-3 (2023), section
4, for the OMM. Both give mean elements in TEME, the frame of the true equator and mean equinox of the elements' epoch.
"""

import math
from collections.abc import Mapping
from datetime import datetime
from typing import Any

#: The numbers of an OMM that SGP4 uses.
OMM_NUMBERS = (
    "MEAN_MOTION",
    "ECCENTRICITY",
    "INCLINATION",
    "RA_OF_ASC_NODE",
    "ARG_OF_PERICENTER",
    "MEAN_ANOMALY",
    "BSTAR",
)

#: What an OMM must say of itself, where it says anything, for SGP4 to be the theory its elements belong to.
_OMM_WORDS = {
    "CENTER_NAME": ("EARTH",),
    "REF_FRAME": ("TEME",),
    "TIME_SYSTEM": ("UTC",),
    "MEAN_ELEMENT_THEORY": ("SGP4", "SGP/SGP4"),
}

#: The ephemeris type of SGP4-XP, in both formats: elements of another theory, which SGP4 would misread.
_SGP4_XP = "4"

#: The numbers of a TLE by line: what they are, and the columns, counted from 0.
_TLE_NUMBERS = {
    0: (("epoch", 18, 32), ("mean motion's first derivative", 33, 43)),
    1: (
        ("inclination", 8, 16),
        ("right ascension of the node", 17, 25),
        ("eccentricity", 26, 33),
        ("argument of perigee", 34, 42),
        ("mean anomaly", 43, 51),
        ("mean motion", 52, 63),
    ),
}

_TLE_LENGTH = 69

#: More turns a day than any orbit above the ground has.
_MOST_TURNS_A_DAY = 18.0


def tle_complaint(lines: tuple[str, str] | None) -> str | None:
    """Return the first error in the two lines of a TLE (no title line), or None."""
    for number, line in enumerate(lines or ()):
        complaint = _line_complaint(number, line)
        if complaint:
            return f"line {number + 1} {complaint}"
    if lines and lines[0][2:7] != lines[1][2:7]:
        return f"the lines are of two objects, {lines[0][2:7]} and {lines[1][2:7]}"
    if lines and lines[0][62] == _SGP4_XP:
        return "these are elements for SGP4-XP (ephemeris type 4), a theory that is not public"
    return None


def omm_complaint(omm: Mapping[str, Any] | None) -> str | None:
    """Return the first error in the keywords of an OMM, or None; keywords that SGP4 does not use are not checked."""
    if omm is None:
        return None
    missing = [name for name in ("EPOCH", *OMM_NUMBERS) if name not in omm]
    if missing:
        return f"{', '.join(missing)} missing"
    for name, words in _OMM_WORDS.items():
        if name in omm and str(omm[name]).upper() not in words:
            return f"{name}: {omm[name]!r} is not {words[0]}"
    if str(omm.get("EPHEMERIS_TYPE", "0")) == _SGP4_XP:
        return "EPHEMERIS_TYPE: these are elements for SGP4-XP, a theory that is not public"
    return _numbers_complaint(omm) or _epoch_complaint(omm["EPOCH"])


def omm_number(value: Any) -> float:
    """Return a number of an OMM, which some publishers write as text; nan where it is none."""
    try:
        return math.nan if isinstance(value, bool) else float(value)
    except (TypeError, ValueError):
        return math.nan


def omm_epoch(value: Any) -> datetime:
    """Return the epoch of an OMM, without a zone; UTC. Raises `ValueError` where it is no time in UTC."""
    moment = datetime.fromisoformat(str(value).removesuffix("Z"))
    if moment.tzinfo is not None:
        raise ValueError(f"{value!r} is not in UTC")
    return moment


def omm_name(omm: Mapping[str, Any]) -> str:
    """Return how an OMM calls its object."""
    return str(omm.get("OBJECT_NAME") or omm.get("NORAD_CAT_ID") or "the satellite")


def _line_complaint(number: int, line: str) -> str | None:
    if len(line) != _TLE_LENGTH or not line.isascii():
        return f"has {len(line)} characters, not the {_TLE_LENGTH} of a TLE"
    if line[:2] != f"{number + 1} ":
        return f"starts with {line[:2]!r}, not {number + 1} and a blank"
    total = sum(int(character) if character.isdigit() else character == "-" for character in line[:-1]) % 10
    if line[-1] != str(total):
        return f"has the checksum {line[-1]}, and its digits come to {total}"
    for name, first, end in _TLE_NUMBERS[number]:
        if math.isnan(omm_number(line[first:end])):
            return f"has no number for the {name} in columns {first + 1} to {end}: {line[first:end]!r}"
    return None


def _numbers_complaint(omm: Mapping[str, Any]) -> str | None:
    numbers = {name: omm_number(omm[name]) for name in OMM_NUMBERS}
    for name, number in numbers.items():
        if not math.isfinite(number):
            return f"{name}: {omm[name]!r} is not a number"
    if not 0.0 < numbers["MEAN_MOTION"] <= _MOST_TURNS_A_DAY:
        return f"MEAN_MOTION: {numbers['MEAN_MOTION']!r} is outside (0, {_MOST_TURNS_A_DAY:g}] turns a day"
    if not 0.0 <= numbers["ECCENTRICITY"] < 1.0:
        return f"ECCENTRICITY: {numbers['ECCENTRICITY']!r} is outside [0, 1)"
    if not 0.0 <= numbers["INCLINATION"] <= 180.0:
        return f"INCLINATION: {numbers['INCLINATION']!r} is outside [0, 180] deg"
    return None


def _epoch_complaint(value: Any) -> str | None:
    try:
        omm_epoch(value)
    except ValueError:
        return f"EPOCH: {value!r} is not a time in UTC like 2026-04-01T12:00:00.000000"
    return None
