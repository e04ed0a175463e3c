"""SP3 orbits (SP3-a, -c and -d): positions of satellites in the Earth-fixed frame, in kilometres,
at regular epochs.

Source: S. Hilla, "The Extended Standard Product 3 Orbit Format (SP3-d)", 2016. Velocities, where
there are any, are in decimetres a second. A position or velocity of 0 is a missing one.
"""

import math
import re
from collections.abc import Iterator

import numpy as np
from attrs import Factory, define

from opir_core.plugin import BadFileError, StateTable
from opir_readers.states import require_order, require_places, require_velocities
from opir_readers.time_systems import SYSTEMS, utc_s

_HEAD = re.compile(r"#[a-d][PV]\d{4}")
_SYSTEMS = {
    "GPS": "GPS",
    "GAL": "GPS",
    "QZS": "GPS",
    "TAI": "TAI",
    "UTC": "UTC",
    "BDT": "BDT",
    "IRN": "GPS",
    "GLO": "UTC",
}

#: BeiDou's time is 14 s behind that of GPS.
_BDT_S = 14.0


def is_sp3(text: str) -> bool:
    """Return whether a text is an SP3 orbit."""
    return _HEAD.match(text) is not None


@define
class Satellite:
    """The states of a satellite: lines, seconds of UTC since 1970, positions, km, and velocities,
    dm/s.
    """

    lines: list[int] = Factory(list)
    times: list[float] = Factory(list)
    positions: list[list[float]] = Factory(list)
    velocities: list[list[float]] = Factory(list)


def sp3_table(text: str, epoch_us: int, wanted: str | None) -> StateTable:
    """Return the orbit of a satellite, for a scene epoch in microseconds of UTC since 1970.

    `wanted` is its id, like G01, where there are several. Raises `BadFileError`.
    """
    satellites = _satellites(text)
    if not satellites:
        raise BadFileError("has no satellite with a position")
    if wanted is None and len(satellites) > 1:
        raise BadFileError(
            f"has {len(satellites)} satellites; say which with object:"
            f" {', '.join(list(satellites)[:40])}"
        )
    name = next(iter(satellites)) if wanted is None else wanted.strip()
    if name not in satellites:
        raise BadFileError(f"has no satellite {name!r}; it has {', '.join(list(satellites)[:40])}")
    return _table(satellites[name], epoch_us, text[46:51].strip())


def _table(own: Satellite, epoch_us: int, frame: str) -> StateTable:
    if len(own.times) < 2:
        raise BadFileError(f"has {len(own.times)} states of this satellite; at least 2 are needed")
    line_of = own.lines.__getitem__
    time_s = np.array(own.times) - epoch_us * 1e-6
    require_order(time_s, line_of, may_repeat=False)
    position = np.array(own.positions) * 1e3
    require_places(position, line_of)
    velocity = np.array(own.velocities) * 0.1 if len(own.velocities) == len(own.times) else None
    require_velocities(velocity, line_of)
    burns = np.array([[time_s[0], time_s[-1]]])
    run = np.zeros(len(time_s), dtype=np.int64)
    return StateTable(
        time_s, position, velocity, run, burns, line_of, has_dates=True, frame=frame or "ITRF"
    )


def _satellites(text: str) -> dict[str, Satellite]:
    """Return the satellites by id."""
    found: dict[str, Satellite] = {}
    system = _system(text)
    now = math.nan
    at = 0
    for number, line in _data_lines(text):
        if line[0] == "*":
            now = _epoch_s(line, number, system, now)
            at = number
            continue
        if math.isnan(now):
            raise BadFileError(f"line {number}: comes before the first epoch (*)")
        own = found.setdefault(_id(line), Satellite())
        values = _vector(line, number)
        if line[0] == "P" and any(values):
            own.lines.append(number)
            own.times.append(now)
            own.positions.append(values)
        elif line[0] == "V" and any(values) and own.lines and own.lines[-1] > at:
            own.velocities.append(values)
    return {name: own for name, own in found.items() if own.times}


def _data_lines(text: str) -> Iterator[tuple[int, str]]:
    for number, line in enumerate(text.split("\n"), 1):
        if line.startswith("EOF"):
            return
        if line[:1] in ("*", "P", "V"):
            yield number, line


def _system(text: str) -> str:
    """Return the time system of a file: that of its first %c line, GPS without one."""
    for line in text.split("\n", 200)[:200]:
        if line.startswith("%c"):
            name = line[9:12].strip() or line.split()[3]
            system = _SYSTEMS.get(name.upper())
            if system is None and name.lower() not in ("ccc", ""):
                raise BadFileError(f"has times in {name!r}; read are {', '.join(_SYSTEMS)}")
            return system or "GPS"
    return "GPS"


def _epoch_s(line: str, number: int, system: str, before_s: float) -> float:
    """Return an epoch, s of UTC since 1970, that follows one at `before_s` (nan for the first)."""
    words = line[1:].split()
    try:
        year, month, day, hour, minute = (int(word) for word in words[:5])
        seconds = float(words[5])
        # Some agencies count on: 24 h, or 60 min, or day 0, the last of the month before.
        first = np.datetime64(f"{year:04d}-{month:02d}-01", "s").astype(np.int64)
    except (ValueError, IndexError, OverflowError):
        raise BadFileError(
            f"line {number}: {line.strip()[:60]!r} is no epoch: * year month day hour minute second"
        ) from None
    if not (0 <= day <= 31 and 0 <= hour <= 24 and 0 <= minute <= 60 and 0.0 <= seconds < 61.0):
        raise BadFileError(f"line {number}: {line.strip()[:60]!r} is no time of day")
    own = float(first) + 86_400.0 * (day - 1) + 3600.0 * hour + 60.0 * minute
    shift = _BDT_S if system == "BDT" else 0.0
    known = "GPS" if system == "BDT" else system
    assert known in SYSTEMS
    found_s = utc_s(own + shift, known) + seconds
    # Others count the day on and leave the hour at 24, or the hour on and leave the minute at 60.
    excess_s = 86_400.0 if hour == 24 else 3600.0 if minute == 60 else 0.0
    return found_s - excess_s if found_s - excess_s > before_s else found_s


def _id(line: str) -> str:
    """Return the id of a satellite; SP3-a has numbers alone, of GPS."""
    name = line[1:4].strip()
    return f"G{int(name):02d}" if name.isascii() and name.isdigit() else name


def _vector(line: str, number: int) -> list[float]:
    try:
        values = [float(line[first : first + 14]) for first in (4, 18, 32)]
    except ValueError:
        values = [math.nan]
    if not all(map(math.isfinite, values)):
        raise BadFileError(f"line {number}: columns 5 to 46 are not three numbers")
    return values
