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
from opir_readers.states import number_or_nan, single_run
from opir_readers.time_systems import utc_s

_HEAD = re.compile(r"#[a-d][PV]\d{4}")

#: Time systems as files name them, and the system that each keeps time with; BeiDou's time is 14 s
#: behind that of GPS.
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


def is_sp3(text: str) -> bool:
    """Whether a text is an SP3 orbit."""
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


def sp3_table(text: str, epoch_us: int, name: str | None) -> StateTable:
    """Return the orbit of a satellite, for a scene epoch in microseconds of UTC since 1970.

    `name` is its id, like G01, where there are several. Raises `BadFileError`.
    """
    satellites = _satellites(text)
    listed = ", ".join(list(satellites)[:40])
    if not satellites:
        raise BadFileError("has no satellite with a position")
    if name is None and len(satellites) > 1:
        raise BadFileError(f"has {len(satellites)} satellites; say which with object: {listed}")
    key = next(iter(satellites)) if name is None else name.strip()
    if key not in satellites:
        raise BadFileError(f"has no satellite {key!r}; it has {listed}")
    satellite = satellites[key]
    count = len(satellite.times)
    if count < 2:
        raise BadFileError(f"has {count} states of this satellite; at least 2 are needed")
    velocities = satellite.velocities
    return single_run(
        np.array(satellite.times) - epoch_us * 1e-6,
        np.array(satellite.positions) * 1e3,
        np.array(velocities) * 0.1 if len(velocities) == count else None,
        satellite.lines.__getitem__,
        has_dates=True,
        frame=text[46:51].strip() or "ITRF",
    )


def _satellites(text: str) -> dict[str, Satellite]:
    """Return the satellites with positions by id."""
    satellites: dict[str, Satellite] = {}
    system = _system(text)
    epoch_s = math.nan
    epoch_line = 0
    for number, line in _data_lines(text):
        if line[0] == "*":
            epoch_s = _epoch_s(line, number, system, epoch_s)
            epoch_line = number
            continue
        if math.isnan(epoch_s):
            raise BadFileError(f"line {number}: comes before the first epoch (*)")
        satellite = satellites.setdefault(_id(line), Satellite())
        values = [number_or_nan(line[start : start + 14]) for start in (4, 18, 32)]
        if any(map(math.isnan, values)):
            raise BadFileError(f"line {number}: columns 5 to 46 are not three numbers")
        if line[0] == "P" and any(values):
            satellite.lines.append(number)
            satellite.times.append(epoch_s)
            satellite.positions.append(values)
        elif line[0] == "V" and any(values) and max(satellite.lines[-1:], default=0) > epoch_line:
            satellite.velocities.append(values)
    return {name: satellite for name, satellite in satellites.items() if satellite.times}


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


def _epoch_s(line: str, number: int, system: str, previous_s: float) -> float:
    """Return an epoch, s of UTC since 1970, that follows the previous one (nan for the first)."""
    words = line[1:].split()
    try:
        year, month, day, hour, minute = (int(word) for word in words[:5])
        seconds = float(words[5])
        # Some agencies count on: 24 h, or 60 min, or day 0, the last of the month before.
        month_s = np.datetime64(f"{year:04d}-{month:02d}-01", "s").astype(np.int64)
    except (ValueError, IndexError, OverflowError):
        raise BadFileError(
            f"line {number}: {line.strip()[:60]!r} is no epoch: * year month day hour minute second"
        ) from None
    if not (0 <= day <= 31 and 0 <= hour <= 24 and 0 <= minute <= 60 and 0.0 <= seconds < 61.0):
        raise BadFileError(f"line {number}: {line.strip()[:60]!r} is no time of day")
    minute_s = float(month_s) + 86_400.0 * (day - 1) + 3600.0 * hour + 60.0 * minute
    if system == "BDT":
        minute_s += 14.0
        system = "GPS"
    epoch_s = utc_s(minute_s, system) + seconds
    # Others count the day on and leave the hour at 24, or the hour on and leave the minute at 60.
    excess_s = 86_400.0 if hour == 24 else 3600.0 if minute == 60 else 0.0
    return epoch_s - excess_s if epoch_s - excess_s > previous_s else epoch_s


def _id(line: str) -> str:
    """Return the id of a satellite; SP3-a has numbers alone, of GPS."""
    name = line[1:4].strip()
    return f"G{int(name):02d}" if name.isascii() and name.isdigit() else name
