"""STK ephemerides (`.e`): blocks of keywords and states, in metres or kilometres, from a scenario's
epoch on.

Source: the description of the format in the STK documentation, "Ephemeris file format (*.e)".
"""

import math
import re
from collections.abc import Iterator
from datetime import datetime

import numpy as np
from attrs import Factory, define

from opir_core.arrays import FloatArray
from opir_core.geometry import geodetic_to_ecef, vector
from opir_core.plugin import BadFileError, StateTable
from opir_readers.frames import frame_of, is_of_epoch, to_ecef
from opir_readers.published import published
from opir_readers.states import (
    number_or_nan,
    require_angles,
    require_order,
    require_places,
    require_velocities,
)
from opir_readers.time_systems import tai_less_utc_s, utc_s

#: The first word of a line that begins states, of an ephemeris or an attitude.
_KIND_WORD = re.compile(r"(?im)^\s*((?:Ephemeris|Attitude)\w*Time\S*)")

_FRAME_NAMES = (
    "Fixed, J2000, ICRF, TEMEOfDate, TrueOfDate, MeanOfDate, TEMEOfEpoch, TrueOfEpoch and"
    " MeanOfEpoch"
)

#: The kinds of states: their coordinates, and the numbers of a line with the time. Rates of angles
#: are not read.
_KINDS = {
    "ephemeristimepos": ("cartesian", 4),
    "ephemeristimeposvel": ("cartesian", 7),
    "ephemeristimeposvelacc": ("cartesian", 10),
    "ephemerisllatimepos": ("geodetic", 4),
    "ephemerisllatimeposvel": ("geodetic", 7),
    "ephemerisllrtimepos": ("geocentric", 4),
    "ephemerisllrtimeposvel": ("geocentric", 7),
}
_KIND_NAMES = "EphemerisTimePos[Vel[Acc]], EphemerisLLATimePos[Vel] and EphemerisLLRTimePos[Vel]"
_FRAMES_OF_COORDINATES = {
    "geodetic": "latitude, longitude, height above WGS 84",
    "geocentric": "geocentric latitude, longitude, distance from the Earth's centre",
}


@define
class _Ephemeris:
    """Keywords in lower case, the kind of states, and lines and numbers of the states."""

    keywords: dict[str, str] = Factory(dict)
    kind: str = ""
    lines: list[int] = Factory(list)
    rows: list[list[float]] = Factory(list)

    def moment_s(self, keyword: str) -> float:
        """Return the time of a keyword, s of UTC since 1970."""
        # Programs that print seconds with a width leave a blank: 23:59: 47.000.
        text = re.sub(r":\s+", ":", self.keywords.get(keyword.lower(), ""))
        second, _, fraction = text.partition(".")
        try:
            moment = datetime.strptime(second, "%d %b %Y %H:%M:%S")
        except ValueError:
            raise BadFileError(
                f"{keyword} is {text!r}; a time like 1 Apr 2026 12:00:00.000 is needed"
            ) from None
        is_decimal = fraction.isascii() and fraction.isdecimal()
        seconds = (moment - datetime(1970, 1, 1)).total_seconds()
        return seconds + (float(f"0.{fraction}") if is_decimal else 0.0)


def stk_table(text: str, epoch_us: int) -> StateTable:
    """Return the table of an ephemeris for a scene epoch in microseconds of UTC since 1970; raises
    `BadFileError`.
    """
    ephemeris = _ephemeris(text)
    line_of = ephemeris.lines.__getitem__
    coordinates, _ = _KINDS[ephemeris.kind]
    unit_m = _unit_m(ephemeris.keywords.get("distanceunit", "Meters"))
    system = ephemeris.keywords.get("coordinatesystem", "Fixed")
    frame = frame_of(system)
    if not frame:
        raise BadFileError(
            f"CoordinateSystem is {system}; export the ephemeris in one of {_FRAME_NAMES}"
        )
    body = ephemeris.keywords.get("centralbody", "Earth")
    if body.lower() != "earth":
        raise BadFileError(f"CentralBody is {body}; only Earth is taken")
    values = np.array(ephemeris.rows)
    unix_s = _utc_s(ephemeris.moment_s("ScenarioEpoch"), values[:, 0])
    time_s = unix_s - epoch_us * 1e-6
    require_order(time_s, line_of, may_repeat=True)
    if not time_s[-1] > time_s[0]:
        raise BadFileError(f"line {ephemeris.lines[-1]}: all states have the same time")
    with np.errstate(over="ignore"):
        position = _positions(values, coordinates, unit_m)
        has_velocity = coordinates == "cartesian" and values.shape[1] >= 7
        velocity = values[:, 4:7] * unit_m if has_velocity else np.zeros_like(position)
    if coordinates != "cartesian":
        require_angles(np.radians(values[:, 1]), np.radians(values[:, 2]), line_of)
    require_places(position, line_of)
    require_velocities(velocity, line_of)
    frame_s = None
    if is_of_epoch(system):
        frame_s = ephemeris.moment_s("CoordinateSystemEpoch") - epoch_us * 1e-6
    position, velocity = to_ecef(frame, position, velocity, epoch_us, time_s, frame_s)
    return StateTable(
        time_s,
        position,
        velocity if has_velocity else None,
        # A time that stands twice ends a segment and begins the next one.
        np.cumsum(np.diff(time_s, prepend=time_s[0] - 1.0) == 0.0),
        time_s[None, [0, -1]],
        line_of,
        has_dates=True,
        frame=_FRAMES_OF_COORDINATES.get(coordinates, system),
    )


def _positions(values: FloatArray, coordinates: str, unit_m: float) -> FloatArray:
    """Return positions (n, 3), m, of lines (n, 4 or more) with the time first."""
    if coordinates == "cartesian":
        return values[:, 1:4] * unit_m
    latitude = np.radians(values[:, 1])
    longitude = np.radians(values[:, 2])
    distance = values[:, 3] * unit_m
    if coordinates == "geodetic":
        return geodetic_to_ecef(latitude, longitude, distance)
    level = distance * np.cos(latitude)
    return vector(level * np.cos(longitude), level * np.sin(longitude), distance * np.sin(latitude))


def _ephemeris(text: str) -> _Ephemeris:
    ephemeris = _Ephemeris()
    for number, words in _lines_of_ephemeris(text):
        keyword = words[0].lower()
        if keyword in _KINDS:
            ephemeris.kind = keyword
        elif ephemeris.kind:
            ephemeris.lines.append(number)
            ephemeris.rows.append(_numbers(words, _KINDS[ephemeris.kind][1], number))
        else:
            ephemeris.keywords[keyword] = " ".join(words[1:])
    _require_states(ephemeris, text)
    return ephemeris


def _require_states(ephemeris: _Ephemeris, text: str) -> None:
    if not ephemeris.kind:
        word = next(iter(_KIND_WORD.findall(text)), "none")
        raise BadFileError(f"has states of the kind {word}; read are {_KIND_NAMES}")
    time_format = ephemeris.keywords.get("timeformat", "EpSec")
    if time_format.lower() not in ("epsec", "epochseconds"):
        raise BadFileError(
            f"TimeFormat is {time_format}; export times in seconds from the epoch (EpSec)"
        )
    count = len(ephemeris.rows)
    if count < 2:
        raise BadFileError(f"has {count} states; at least 2 are needed")


def _lines_of_ephemeris(text: str) -> Iterator[tuple[int, list[str]]]:
    """Yield number and words of the lines of keywords and states, without the block of the
    segments' boundaries.
    """
    is_boundary = False
    for number, line in enumerate(text.split("\n"), 1):
        words = line.split("#")[0].split()
        keyword = words[0].upper() if words else ""
        if (keyword == "END" and not is_boundary) or keyword.startswith("COVARIANCETIME"):
            return
        if keyword in ("BEGIN", "END"):
            is_boundary = keyword == "BEGIN" and words[-1].lower() == "segmentboundarytimes"
        elif words and not is_boundary and not keyword.startswith("STK.V."):
            yield number, words


def _numbers(words: list[str], count: int, number: int) -> list[float]:
    if len(words) != count:
        raise BadFileError(f"line {number}: has {len(words)} values; a state has {count}")
    values = list(map(number_or_nan, words))
    if any(map(math.isnan, values)):
        raise BadFileError(f"line {number}: {' '.join(words)!r} are not {count} finite numbers")
    return values


def _utc_s(epoch_s: float, elapsed_s: FloatArray) -> FloatArray:
    """Return seconds of UTC since 1970 (n,) of seconds after an epoch, which count leap seconds."""
    first_s = epoch_s + min(float(elapsed_s.min()), 0.0)
    last_s = epoch_s + max(float(elapsed_s.max()), 0.0)
    if tai_less_utc_s(first_s) == tai_less_utc_s(last_s):
        return epoch_s + elapsed_s
    tai_s = epoch_s + tai_less_utc_s(epoch_s)
    return np.array([utc_s(tai_s + after_s, "TAI") for after_s in elapsed_s.tolist()])


def _unit_m(word: str) -> float:
    units_m: dict[str, float] = published("units")["STK"]
    if word.lower() not in units_m:
        raise BadFileError(f"DistanceUnit is {word}; read are {', '.join(units_m)}")
    return units_m[word.lower()]
