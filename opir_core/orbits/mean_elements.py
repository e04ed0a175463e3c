"""Published mean elements for SGP4: what a two-line element set or an Orbit Mean-Elements Message
must hold.

Sources: Hoots and Roehrich, Spacetrack Report No. 3 (1980), for the columns of a TLE; CCSDS
502.0-B-3 (2023), section 4, for the OMM. Both give mean elements in TEME, the frame of the true
equator and mean equinox of the elements' epoch.
"""

import math
import re
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

#: What an OMM must say of itself, where it says anything, for SGP4 to be the theory its elements
#: belong to.
_OMM_WORDS = {
    "CENTER_NAME": ("EARTH",),
    "REF_FRAME": ("TEME",),
    "TIME_SYSTEM": ("UTC",),
    "MEAN_ELEMENT_THEORY": ("SGP4", "SGP/SGP4"),
}

#: The ephemeris type of SGP4-XP, in both formats: elements of another theory, which SGP4 would
#: misread.
_SGP4_XP = "4"

#: The numbers of a TLE by line: what they are, the columns, counted from 0, and their form.
_PLAIN = r" *[+-]?\d*\.?\d* *"
_DIGITS = r"\d{7}"
_POWER = r"[ +-]\d{5}[+-]\d|[ +-]0{5}[ +-]\d"
_TLE_NUMBERS = {
    0: (
        ("epoch", 18, 32, r"\d\d[ \d]{3}\.\d{8}"),
        ("mean motion's first derivative", 33, 43, _PLAIN),
        ("mean motion's second derivative", 44, 52, _POWER),
        ("drag term B*", 53, 61, _POWER),
    ),
    1: (
        ("inclination", 8, 16, _PLAIN),
        ("right ascension of the node", 17, 25, _PLAIN),
        ("eccentricity", 26, 33, _DIGITS),
        ("argument of perigee", 34, 42, _PLAIN),
        ("mean anomaly", 43, 51, _PLAIN),
        ("mean motion", 52, 63, _PLAIN),
    ),
}

_TLE_LENGTH = 69

#: More turns a day than any orbit above the ground has.
_MOST_TURNS_A_DAY = 18.0

#: Fewer turns a day than any nearly round orbit has: at 150 000 km, where the Moon's pull is felt.
#: Elements for SGP4's own code have radians a minute.
_FEWEST_TURNS_A_DAY = 0.15
_ROUND = 0.25
_TURNS_A_DAY = 720.0 / math.pi

#: A larger drag term, per Earth radius, than elements have: 1.2 on the day of a launch, hundreds
#: where a sign is lost.
_MOST_BSTAR = 10.0


def tle_complaint(lines: tuple[str, str] | None) -> str | None:
    """Return the errors in the two lines of a TLE (no title line), or None."""
    if lines is None:
        return None
    errors = [
        f"line {number + 1} {words}"
        for number, line in enumerate(lines)
        for words in _line_complaints(number, line)
    ]
    if errors:
        return "; ".join(errors)
    if lines[0][2:7] != lines[1][2:7]:
        return f"the lines are of two objects, {lines[0][2:7]} and {lines[1][2:7]}"
    if lines[0][62] == _SGP4_XP:
        return "these are elements for SGP4-XP (ephemeris type 4), a theory that is not public"
    return None


def omm_complaint(omm: Mapping[str, Any] | None) -> str | None:
    """Return the errors in the keywords of an OMM, or None; keywords that SGP4 does not use are not
    checked.
    """
    if omm is None:
        return None
    missing = [name for name in ("EPOCH", *OMM_NUMBERS) if name not in omm]
    if missing:
        return f"{', '.join(missing)} missing"
    errors = [
        f"{name}: {omm[name]!r} is not {words[0]}"
        for name, words in _OMM_WORDS.items()
        if name in omm and str(omm[name]).upper() not in words
    ]
    if str(omm.get("EPHEMERIS_TYPE", "0")) == _SGP4_XP:
        errors.append("EPHEMERIS_TYPE: these are elements for SGP4-XP, a theory that is not public")
    errors += _number_complaints(omm)
    if _epoch_complaint(omm["EPOCH"]):
        errors.append(_epoch_complaint(omm["EPOCH"]))
    return "; ".join(errors) or None


def omm_number(value: Any) -> float:
    """Return a number of an OMM, which some publishers write as text; nan for any other value."""
    try:
        return math.nan if isinstance(value, bool) else float(value)
    except (TypeError, ValueError, OverflowError):
        return math.nan


def omm_epoch(value: Any) -> datetime:
    """Return the epoch of an OMM, without a zone; UTC. Raises `ValueError` for any other
    text.
    """
    text = str(value).strip().removesuffix("Z")
    if text[4:5] == "-" and text[7:8].isdigit():  # a day of the year, 2026-091T12:00:00
        text = f"{datetime.strptime(text[:8], '%Y-%j'):%Y-%m-%d}{text[8:]}"
    moment = datetime.fromisoformat(text)
    if moment.tzinfo is not None:
        raise ValueError(f"{value!r} is not in UTC")
    return moment


def omm_name(omm: Mapping[str, Any]) -> str:
    """Return how an OMM calls its object, blanks for characters that are not printable."""
    name = str(omm.get("OBJECT_NAME") or omm.get("NORAD_CAT_ID") or "the satellite")
    return "".join(letter if letter.isprintable() else " " for letter in name)


def age_warning(name: str, age_days: float) -> str | None:
    """Return a warning about the position error of elements as old as this at the scene's epoch,
    None if they are young enough.
    """
    days = abs(age_days)
    # Elements farther from the scene than this give a warning, for SGP4 errs by 1 to 3 km a day.
    if days <= 14.0:
        return None
    age = f"{days:.0f} days" if days < 2.0 * 365.25 else f"{days / 365.25:.1f} years"
    low, high = (days * error_km for error_km in (1.0, 3.0))
    where = f"{low:.0f} to {high:.0f} km away" if high < 5000.0 else "anywhere along its orbit"
    return (
        f"the elements of {name} are {age} {'older' if age_days > 0.0 else 'younger'} than the"
        f" scene; SGP4 errs by 1 to"
        f" 3 km a day, so the satellite may be {where}: take elements of the scene's days, or set"
        f" the scene's epoch"
    )


def _line_complaints(number: int, line: str) -> list[str]:
    if not line.isascii():
        foreign = next(character for character in line if not character.isascii())
        return [
            (
                f"has the character {foreign!r} (U+{ord(foreign):04X}), which no TLE has; copy it as"
                f" plain text"
            )
        ]
    if len(line) != _TLE_LENGTH:
        return [f"has {len(line)} characters, not the {_TLE_LENGTH} of a TLE"]
    if line[:2] != f"{number + 1} ":
        return [f"starts with {line[:2]!r}, not {number + 1} and a blank"]
    errors = [words for field in _TLE_NUMBERS[number] if (words := _field_complaint(line, *field))]
    total = (
        sum(int(character) if character.isdigit() else character == "-" for character in line[:-1])
        % 10
    )
    if line[-1] != str(total):
        errors.append(f"has the checksum {line[-1]}, and its digits come to {total}")
    return errors


def _field_complaint(line: str, name: str, start: int, end: int, form: str) -> str:
    text = line[start:end]
    if not re.fullmatch(form, text) or not any(map(str.isdigit, text)):
        hint = f"; write {_as_power(text)}" if form == _POWER else ""
        return f"has no number for the {name} in columns {start + 1} to {end}: {text!r}{hint}"
    if name == "drag term B*" and abs(_power(text)) > _MOST_BSTAR:
        return (
            f"has the {name} {_power(text):g}, more than any satellite's ({_MOST_BSTAR:g}); is a"
            f" sign lost?"
        )
    if name == "inclination" and not 0.0 <= float(text) <= 180.0:
        return f"has the inclination {float(text):g}, outside [0, 180] deg"
    if name == "mean motion" and not 0.0 < float(text) <= _MOST_TURNS_A_DAY:
        return (
            f"has the mean motion {float(text):g}, outside (0, {_MOST_TURNS_A_DAY:g}] turns a day"
        )
    return ""


def _power(text: str) -> float:
    """Return the number of a field like ` 11606-4`: a sign, five digits after a decimal point, the
    power of ten.
    """
    return float(f"{text[0].strip()}.{text[1:6]}e{text[6:].replace(' ', '+')}")


def _as_power(text: str) -> str:
    """Return a number as such a field, or how to write one."""
    number = omm_number(text)
    if "." not in text or not 1e-10 <= abs(number) < 1e9:
        return "a sign or a blank, five digits, and the power of ten with its sign, like ' 11606-4'"
    power = math.floor(math.log10(abs(number))) + 1
    return repr(f"{'-' if number < 0.0 else ' '}{abs(number) / 10.0**power * 1e5:05.0f}{power:+d}")


def _number_complaints(omm: Mapping[str, Any]) -> list[str]:
    numbers = {name: omm_number(omm[name]) for name in OMM_NUMBERS}
    errors = [
        f"{name}: {omm[name]!r} is not a number"
        for name, number in numbers.items()
        if not math.isfinite(number)
    ]
    motion, eccentricity, inclination = (numbers[name] for name in OMM_NUMBERS[:3])
    if math.isfinite(motion) and not 0.0 < motion <= _MOST_TURNS_A_DAY:
        errors.append(f"MEAN_MOTION: {motion!r} is outside (0, {_MOST_TURNS_A_DAY:g}] turns a day")
    elif motion < _FEWEST_TURNS_A_DAY and 0.0 <= eccentricity < _ROUND:
        errors.append(
            f"MEAN_MOTION: {motion!r} turns a day is no orbit of a satellite with this eccentricity;"
            f" in radians a minute it is {_TURNS_A_DAY * motion:.8g} turns a day: give that"
        )
    if math.isfinite(eccentricity) and not 0.0 <= eccentricity < 1.0:
        errors.append(f"ECCENTRICITY: {eccentricity!r} is outside [0, 1)")
    if math.isfinite(inclination) and not 0.0 <= inclination <= 180.0:
        errors.append(f"INCLINATION: {inclination!r} is outside [0, 180] deg")
    if math.isfinite(numbers["BSTAR"]) and abs(numbers["BSTAR"]) > _MOST_BSTAR:
        errors.append(f"BSTAR: {numbers['BSTAR']!r} is outside [-{_MOST_BSTAR:g}, {_MOST_BSTAR:g}]")
    return errors


def _epoch_complaint(value: Any) -> str:
    try:
        omm_epoch(value)
    except ValueError:
        return f"EPOCH: {value!r} is not a time in UTC like 2026-04-01T12:00:00.000000"
    return ""
