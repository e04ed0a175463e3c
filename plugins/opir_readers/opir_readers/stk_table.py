"""STK ephemerides (`.e`): blocks of keywords and states, in metres or kilometres, from a scenario's
epoch on.

Source: the description of the format in the STK documentation, "Ephemeris file format (*.e)".
"""

import math
import re
from collections.abc import Iterator, Mapping
from datetime import datetime
from typing import TypeVar

import numpy as np

from opir_core.arrays import FloatArray
from opir_core.geometry import geodetic_to_ecef
from opir_core.plugin import BadFileError, StateTable
from opir_readers.frames import frame_of, is_of_epoch, to_ecef
from opir_readers.states import require_angles, require_order, require_places, require_velocities
from opir_readers.time_systems import tai_less_utc_s, utc_s

Known = TypeVar("Known")

_UNIX = datetime(1970, 1, 1)

_UNITS_M = {"meters": 1.0, "kilometers": 1e3, "feet": 0.3048, "nauticalmiles": 1852.0}

#: The first word of a line that begins states, of an ephemeris or an attitude.
_KIND_WORD = re.compile(r"(?im)^\s*((?:Ephemeris|Attitude)\w*Time\S*)")

_SYSTEMS = (
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


def stk_table(text: str, epoch_us: int) -> StateTable:
    """Return the table of an ephemeris for a scene epoch in microseconds of UTC since 1970; raises
    `BadFileError`.
    """
    keywords, kind, lines, rows = _parts(text)
    coordinates, _ = _KINDS[kind]
    unit_m = _chosen(_UNITS_M, "DistanceUnit", keywords.get("distanceunit", "Meters"))
    system = keywords.get("coordinatesystem", "Fixed")
    frame = frame_of(system)
    if not frame:
        raise BadFileError(
            f"CoordinateSystem is {system}; export the ephemeris in one of {_SYSTEMS}"
        )
    if keywords.get("centralbody", "Earth").lower() != "earth":
        raise BadFileError(f"CentralBody is {keywords['centralbody']}; only Earth is taken")
    values = np.array(rows)
    time_s = _utc_s(_moment_s(keywords, "ScenarioEpoch"), values[:, 0]) - epoch_us * 1e-6
    require_order(time_s, lines.__getitem__, may_repeat=True)
    if not time_s[-1] > time_s[0]:
        raise BadFileError(f"line {lines[-1]}: all states have the same time")
    with np.errstate(over="ignore"):
        position, velocity = _states(values, coordinates, unit_m)
    if coordinates != "cartesian":
        require_angles(np.radians(values[:, 1]), np.radians(values[:, 2]), lines.__getitem__)
    require_places(position, lines.__getitem__)
    require_velocities(velocity, lines.__getitem__)
    moving = np.zeros_like(position) if velocity is None else velocity
    frame_s = (
        _moment_s(keywords, "CoordinateSystemEpoch") - epoch_us * 1e-6
        if is_of_epoch(system)
        else None
    )
    turned, rate = to_ecef(frame, position, moving, epoch_us, time_s, frame_s)
    burns_s = np.array([[time_s[0], time_s[-1]]])
    # A time that stands twice ends a segment and begins the next one.
    run = np.cumsum(np.diff(time_s, prepend=time_s[0] - 1.0) == 0.0)
    words = _FRAMES_OF_COORDINATES.get(coordinates, system)
    own = None if velocity is None else rate
    return StateTable(
        time_s, turned, own, run, burns_s, lines.__getitem__, has_dates=True, frame=words
    )


def _states(
    values: FloatArray, coordinates: str, unit_m: float
) -> tuple[FloatArray, FloatArray | None]:
    """Return positions and velocities (n, 3), m and m/s."""
    if coordinates == "cartesian":
        return values[:, 1:4] * unit_m, values[:, 4:7] * unit_m if values.shape[1] >= 7 else None
    latitude = np.radians(values[:, 1])
    longitude = np.radians(values[:, 2])
    third = values[:, 3] * unit_m
    if coordinates == "geodetic":
        return geodetic_to_ecef(latitude, longitude, third), None
    level = third * np.cos(latitude)
    return np.stack(
        [level * np.cos(longitude), level * np.sin(longitude), third * np.sin(latitude)], axis=1
    ), None


def _parts(text: str) -> tuple[dict[str, str], str, list[int], list[list[float]]]:
    """Return the keywords, the kind of states, and lines and numbers of the states."""
    keywords = dict[str, str]()
    kind = ""
    lines = list[int]()
    rows = list[list[float]]()
    for number, words in _lines_of_ephemeris(text):
        if words[0].lower() in _KINDS:
            kind = words[0].lower()
        elif kind:
            lines.append(number)
            rows.append(_numbers(words, _KINDS[kind][1], number))
        else:
            keywords[words[0].lower()] = " ".join(words[1:])
    if not kind:
        own = next((word for word in _KIND_WORD.findall(text)), "")
        raise BadFileError(f"has states of the kind {own or 'none'}; read are {_KIND_NAMES}")
    if keywords.get("timeformat", "EpSec").lower() not in ("epsec", "epochseconds"):
        raise BadFileError(
            f"TimeFormat is {keywords['timeformat']}; export times in seconds from the epoch"
            f" (EpSec)"
        )
    if len(rows) < 2:
        raise BadFileError(f"has {len(rows)} states; at least 2 are needed")
    return keywords, kind, lines, rows


def _lines_of_ephemeris(text: str) -> Iterator[tuple[int, list[str]]]:
    """Yield number and words of the lines of keywords and states, without the block of the
    segments' boundaries.
    """
    is_boundary = False
    for number, line in enumerate(text.split("\n"), 1):
        words = line.split("#")[0].split()
        first = words[0].upper() if words else ""
        if (first == "END" and not is_boundary) or first.startswith("COVARIANCETIME"):
            return
        if first in ("BEGIN", "END"):
            is_boundary = first == "BEGIN" and words[-1].lower() == "segmentboundarytimes"
        elif words and not is_boundary and not first.startswith("STK.V."):
            yield number, words


def _numbers(words: list[str], count: int, number: int) -> list[float]:
    if len(words) != count:
        raise BadFileError(f"line {number}: has {len(words)} values; a state has {count}")
    try:
        values = [float(word) for word in words]
    except ValueError:
        values = [math.nan]
    if not all(map(math.isfinite, values)):
        raise BadFileError(f"line {number}: {' '.join(words)!r} are not {count} finite numbers")
    return values


def _moment_s(keywords: Mapping[str, str], keyword: str) -> float:
    """Return the time of a keyword, s of UTC since 1970."""
    text = keywords.get(keyword.lower(), "")
    # Programs that print seconds with a width leave a blank: 23:59: 47.000.
    text = re.sub(r":\s+", ":", text)
    whole, _, fraction = text.partition(".")
    try:
        moment = datetime.strptime(whole, "%d %b %Y %H:%M:%S")
    except ValueError:
        raise BadFileError(
            f"{keyword} is {text!r}; a time like 1 Apr 2026 12:00:00.000 is needed"
        ) from None
    seconds = (moment - _UNIX).total_seconds()
    return seconds + (
        float(f"0.{fraction}") if fraction.isascii() and fraction.isdecimal() else 0.0
    )


def _utc_s(epoch_s: float, elapsed_s: FloatArray) -> FloatArray:
    """Return seconds of UTC since 1970 (n,) of seconds after an epoch, which count leap seconds."""
    first_s = epoch_s + min(float(elapsed_s.min()), 0.0)
    last_s = epoch_s + max(float(elapsed_s.max()), 0.0)
    if tai_less_utc_s(first_s) == tai_less_utc_s(last_s):
        return epoch_s + elapsed_s
    tai_s = epoch_s + tai_less_utc_s(epoch_s)
    return np.array([utc_s(tai_s + after_s, "TAI") for after_s in elapsed_s.tolist()])


def _chosen(known: Mapping[str, Known], keyword: str, word: str) -> Known:
    if word.lower() not in known:
        raise BadFileError(f"{keyword} is {word}; read are {', '.join(known)}")
    return known[word.lower()]
