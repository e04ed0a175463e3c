"""Telemetry of launch webcasts: speed and altitude over time, with launch point and azimuth.

Speed is relative to the Earth, altitude above the launch point. Both are rounded: smoothing splines
are fitted to them, and what these leave is noted. The climb is the rate of the altitude, the rest
of the speed is over the ground: along the azimuth of the launch, turned by the Earth's rotation
alone (no yaw steering, which no webcast shows). Where a boostback takes the speed over the ground
through its least, it turns round.
"""

import csv
import io
import json
import math
import re
from collections.abc import Iterator, Mapping, Sequence
from contextlib import suppress
from typing import Any

import numpy as np

from opir_core.arrays import BoolArray, FloatArray
from opir_core.constants import (
    EARTH_ECCENTRICITY_SQUARED,
    EARTH_EQUATORIAL_RADIUS_M,
    EARTH_ROTATION_RAD_S,
)
from opir_core.geometry import east_north_up_axes, geodetic_to_ecef
from opir_core.plugin import BadFileError, StateTable
from opir_readers.flights.burns import AIRLESS_M, LEAST_THRUST_M_S2, burns_s
from opir_readers.flights.coasting import misread_speeds
from opir_readers.flights.site import Site
from opir_readers.flights.smoothing import (
    Smoothed,
    rounding_sigma,
    smoothing_spline,
    speed_rounding_sigma,
)
from opir_readers.states import MOST_BURNS

_HEAD = 4000
_EARTH_RADIUS_M = 6_371_000.0
_GRAVITY_M_S2 = 9.81

#: The fewest values, and the least noise that is assumed, m and m/s: no webcast is better.
_FEWEST = 20
_LEAST_HEIGHT_M = 1.0
_LEAST_SPEED_M_S = 0.05

#: The longest time that a row stands for, s: what is between is as long as the splines make it, not
#: as the file.
_MOST_S_A_ROW = 30.0

#: States of the flight are this far apart, s.
_STEP_S = 1.0

#: Events that begin and end a burn, by the names that published telemetry gives them.
_BURNS = (
    ("", "meco"),
    ("ses1", "seco1"),
    ("ses2", "seco2"),
    ("boostback_start", "boostback_end"),
    ("entry_start", "entry_end"),
    ("landing_start", "landing_end"),
)

_NAMES = {
    "time": ("time", "t", "time_s", "seconds"),
    "speed": ("velocity", "speed", "velocity_m_s", "speed_m_s", "speed_km_h", "velocity_km_h"),
    "altitude": ("altitude", "altitude_km", "altitude_m", "height_km"),
}


def is_webcast(text: str) -> bool:
    """Return whether a text is JSON or CSV of time, speed and altitude, and of no places."""
    head = text[:_HEAD].lstrip()
    if head[:1] in ("{", "["):
        return (
            '"altitude"' in text[: 200 * _HEAD]
            and re.search(r'"(velocity|speed)"', text[: 200 * _HEAD]) is not None
        )
    names = {name.strip().strip('"').lower() for name in head.partition("\n")[0].split(",")}
    return (
        len(names) >= 3
        and all(names & set(known) for known in _NAMES.values())
        and not any("lat" in n for n in names)
    )


def webcast_table(
    text: str,
    site: Site,
    height_noise_m: float | None,
    speed_noise_m_s: float | None,
    start_s: float,
) -> StateTable:
    """Return the flight of a text, with velocities; noises of None are those of the rounding of the
    file's numbers.

    Raises `BadFileError`.
    """
    columns, events = _columns(text)
    time_s, speed, height = _in_order(*columns)
    complaint = misread_speeds(time_s, speed, height)
    if complaint:
        raise BadFileError(complaint)
    fits, notes = _fits(time_s, speed, height, height_noise_m, speed_noise_m_s)
    grid = _grid(time_s, events)
    position, velocity = _path(grid, fits, site, _turn_s(grid, fits, events))
    run = np.zeros(len(grid), dtype=np.int64)
    burns = _burns_of_events(events, grid)
    if burns is None:
        burns = burns_s(grid, _is_thrusting(grid, fits))
        if not len(burns):
            raise BadFileError("shows no acceleration of a burn; are speeds in other units?")
        listed = ", ".join(f"{start:.1f} to {end:.1f} s" for start, end in burns.tolist())
        notes = (*notes, f"burns by acceleration: {listed}")
    burns = burns[:MOST_BURNS]
    return StateTable(
        grid + start_s,
        position,
        velocity,
        run,
        burns + start_s,
        lambda _row: 1,
        notes,
        frame=_FRAME,
    )


_FRAME = "speed and altitude from a launch point, along an azimuth that the Earth's rotation turns"


def _columns(text: str) -> tuple[tuple[FloatArray, FloatArray, FloatArray], Mapping[str, float]]:
    """Return times, s, speeds, m/s, and altitudes, m, and the events by name."""
    if text.lstrip()[:1] not in ("{", "["):
        return _of_csv(text), {}
    rows = list(_json_values(text))
    events: dict[str, float] = {}
    points: list[Mapping[str, Any]] = []
    for value in rows:
        _take(value, points, events)
    if not points:
        raise BadFileError("has no time, velocity and altitude")
    return _numbers(points, "velocity" if "velocity" in points[0] else "speed"), events


def _json_values(text: str) -> Iterator[Any]:
    try:
        yield json.loads(text)
        return
    except (ValueError, RecursionError):
        pass
    for number, line in enumerate(text.split("\n"), 1):
        if line.strip():
            try:
                yield json.loads(line)
            except (ValueError, RecursionError) as error:
                raise BadFileError(f"line {number}: is not JSON: {error}") from error


def _take(
    value: Any, points: list[Mapping[str, Any]], events: dict[str, float], depth: int = 0
) -> None:
    """Add the points and events of a JSON value: of arrays by name, of objects, of lists of
    either.
    """
    if depth > 6:
        return
    if isinstance(value, list):
        for each in value:
            _take(each, points, events, depth + 1)
        return
    if not isinstance(value, dict):
        return
    known = [value.get("time"), value.get("velocity", value.get("speed")), value.get("altitude")]
    names = ("time", "velocity" if "velocity" in value else "speed", "altitude")
    if all(isinstance(each, list) for each in known):
        points += [dict(zip(names, each, strict=True)) for each in zip(*known, strict=False)]
    elif "time" in value and known[1] is not None:
        points.append(value)
    else:
        for each in value.values():
            _take(each, points, events, depth + 1)
    named = {name: _number(value.get(name)) for name in _EVENTS}
    events |= {name: time_s for name, time_s in named.items() if math.isfinite(time_s)}


_EVENTS = {name for pair in _BURNS for name in pair if name}


def _numbers(
    points: Sequence[Mapping[str, Any]], speed: str
) -> tuple[FloatArray, FloatArray, FloatArray]:
    rows = [[_number(point.get(name)) for name in ("time", speed, "altitude")] for point in points]
    values = np.array(rows).reshape(-1, 3)
    # Published telemetry gives altitudes in kilometres; no ascent has none above a kilometre in
    # metres.
    scale = 1e3 if np.nanmax(np.abs(values[:, 2]), initial=0.0) < 5000.0 else 1.0
    return values[:, 0], values[:, 1], values[:, 2] * scale


def _number(value: Any) -> float:
    """Return a number of JSON, nan for anything else and for integers beyond the largest number."""
    with suppress(OverflowError):
        return (
            float(value)
            if isinstance(value, int | float) and not isinstance(value, bool)
            else math.nan
        )
    return math.nan


def _of_csv(text: str) -> tuple[FloatArray, FloatArray, FloatArray]:
    reader = csv.reader(io.StringIO(text))
    try:
        rows = [row for row in reader if row and not row[0].lstrip().startswith("#")]
    except csv.Error as error:
        raise BadFileError(f"line {reader.line_num}: not CSV: {error}") from error
    names = [name.strip().lower() for name in rows[0]] if rows else []
    places = {
        kind: next((names.index(name) for name in known if name in names), -1)
        for kind, known in _NAMES.items()
    }
    if min(places.values()) < 0:
        raise BadFileError("line 1: names no time, speed and altitude")
    values = np.array(
        [[_cell(row, place) for place in places.values()] for row in rows[1:]]
    ).reshape(-1, 3)
    speed = names[places["speed"]]
    altitude = names[places["altitude"]]
    is_km = altitude.endswith("_km") or (
        altitude == "altitude" and np.nanmax(np.abs(values[:, 2]), initial=0.0) < 5000.0
    )
    return (
        values[:, 0],
        values[:, 1] / (3.6 if speed.endswith("_km_h") else 1.0),
        values[:, 2] * (1e3 if is_km else 1.0),
    )


def _cell(row: Sequence[str], place: int) -> float:
    try:
        return float(row[place])
    except (IndexError, ValueError):
        return math.nan


def _in_order(
    time_s: FloatArray, speed: FloatArray, height: FloatArray
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Return the rows with all three numbers, each time once."""
    good = np.isfinite(time_s) & (np.isfinite(speed) | np.isfinite(height))
    time_s = time_s[good]
    speed = speed[good]
    height = height[good]
    order = np.unique(time_s, return_index=True)[1]
    time_s = time_s[order]
    speed = speed[order]
    height = height[order]
    if (
        np.count_nonzero(np.isfinite(speed)) < _FEWEST
        or np.count_nonzero(np.isfinite(height)) < _FEWEST
    ):
        raise BadFileError(
            f"has {len(time_s)} rows with time, speed and altitude; at least {_FEWEST} are needed"
        )
    if time_s[-1] - time_s[0] > _MOST_S_A_ROW * len(time_s):
        raise BadFileError(
            f"has {len(time_s)} rows over {time_s[-1] - time_s[0]:.6g} s; are its times in other"
            f" units?"
        )
    if (
        np.nanmax(np.abs(speed)) > 2e4
        or np.nanmax(np.abs(height)) > 1e7
        or np.abs(time_s).max() > 1e6
    ):
        raise BadFileError(
            "has speeds above 20 km/s, altitudes above 10 000 km or times beyond a million seconds;"
            " check the units"
        )
    return time_s, speed, height


def _fits(
    time_s: FloatArray,
    speed: FloatArray,
    height: FloatArray,
    height_noise_m: float | None,
    speed_noise_m_s: float | None,
) -> tuple[tuple[Smoothed, Smoothed], tuple[str, ...]]:
    """Return the splines of speed and height, and notes for the user."""
    fits = []
    words = []
    for name, unit, values, given, least in (
        ("speed", "m/s", speed, speed_noise_m_s, _LEAST_SPEED_M_S),
        ("altitude", "m", height, height_noise_m, _LEAST_HEIGHT_M),
    ):
        known = np.isfinite(values)
        rounding = speed_rounding_sigma if name == "speed" else rounding_sigma
        sigma = max(rounding(values[known]) if given is None else given, least)
        fit = smoothing_spline(time_s[known], values[known], sigma)
        fits.append(fit)
        left_out = f", {fit.outliers} left out" if fit.outliers else ""
        stated = "of the rounding" if given is None else "as stated"
        words.append(
            f"{name} smoothed to a noise of {sigma:.3g} {unit} {stated}: {fit.residual:.3g} {unit}"
            f" rms left{left_out}"
        )
    return (fits[0], fits[1]), tuple(words)


def _grid(time_s: FloatArray, events: Mapping[str, float]) -> FloatArray:
    """Return the times of the states: every second, and those of the events."""
    first = float(time_s[0])
    last = float(time_s[-1])
    count = max(math.ceil((last - first) / _STEP_S), 2)
    inside = [time for time in events.values() if first < time < last]
    grid = np.unique(np.concatenate([np.linspace(first, last, count + 1), inside]))
    return grid[np.diff(grid, prepend=-np.inf) > 1e-3]


def _turn_s(
    time_s: FloatArray, fits: tuple[Smoothed, Smoothed], events: Mapping[str, float]
) -> float:
    """Return when a boostback turns the flight round, inf where none does: where the speed over the
    ground is least.
    """
    start, end = (events.get(f"boostback_{edge}", math.inf) for edge in ("start", "end"))
    during = time_s[(time_s >= start) & (time_s <= end)]
    if len(during) < 3:
        return math.inf
    level, _ = _parts(during, fits)
    least = int(level.argmin())
    return float(during[least]) if level[-1] > 1.2 * level[least] else math.inf


def _path(
    time_s: FloatArray, fits: tuple[Smoothed, Smoothed], site: Site, turn_s: float
) -> tuple[FloatArray, FloatArray]:
    """Return positions and velocities (n, 3) in ECEF: climb by the altitude, the rest of the speed
    over the ground.
    """
    fine = np.linspace(time_s[0], time_s[-1], 4 * len(time_s) + 1)
    level, climb = _parts(fine, fits)
    level = np.where(fine < turn_s, level, -level)
    latitude, longitude, heading = _ground_track(fine, level, climb, fits[1].at(fine), site)
    places = [np.interp(time_s, fine, values) for values in (latitude, longitude, heading)]
    level, climb = _parts(time_s, fits)
    level = np.where(time_s < turn_s, level, -level)
    height = np.maximum(fits[1].at(time_s), 0.0) + site.height_m
    axes = east_north_up_axes(places[0], places[1])
    local = np.stack([level * np.sin(places[2]), level * np.cos(places[2]), climb], axis=1)
    velocity = (local[:, :, None] * axes).sum(axis=1)
    return geodetic_to_ecef(places[0], places[1], height), np.asarray(velocity)


def _parts(time_s: FloatArray, fits: tuple[Smoothed, Smoothed]) -> tuple[FloatArray, FloatArray]:
    """Return speeds over the ground and of climb (n,), m/s."""
    speed = np.maximum(fits[0].at(time_s), 0.0)
    climb = np.clip(fits[1].at(time_s, 1), -speed, speed)
    return np.sqrt(speed * speed - climb * climb), climb


def _ground_track(
    time_s: FloatArray, level: FloatArray, climb: FloatArray, height: FloatArray, site: Site
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Return latitudes, longitudes and headings (n,), rad, along a path that only the Earth's
    rotation turns.

    Over the rotating Earth the heading of what no side force acts on turns by the Coriolis
    acceleration across it, 2 Ω (v sin φ - climb cos φ cos ψ) / v, and by the convergence of
    meridians, v sin ψ tan φ / r.
    """
    latitude = site.latitude_rad
    longitude = site.longitude_rad
    heading = site.azimuth_rad
    track = [(latitude, longitude, heading)]
    step = float(time_s[1] - time_s[0])
    for v, up, h in zip(
        level[:-1].tolist(), climb[:-1].tolist(), height[:-1].tolist(), strict=True
    ):
        radius = _EARTH_RADIUS_M + h
        cosine = max(math.cos(latitude), 1e-6)
        turn = v * math.sin(heading) * math.tan(latitude) / radius if cosine > 1e-3 else 0.0
        if abs(v) > max(up, 100.0) or abs(v) > 500.0:
            turn += (
                2.0
                * EARTH_ROTATION_RAD_S
                * (math.sin(latitude) - up / v * cosine * math.cos(heading))
            )
        north, prime = _radii(latitude, h)
        latitude += v * math.cos(heading) / north * step
        longitude += v * math.sin(heading) / (prime * cosine) * step
        heading += turn * step
        latitude = min(max(latitude, -0.5 * math.pi), 0.5 * math.pi)
        track.append((latitude, longitude, heading))
    columns = np.array(track).T
    return columns[0], columns[1], columns[2]


def _radii(latitude: float, height: float) -> tuple[float, float]:
    """Return the radii of curvature of meridian and prime vertical at a height, m."""
    a = EARTH_EQUATORIAL_RADIUS_M
    e2 = EARTH_ECCENTRICITY_SQUARED
    w = 1.0 - e2 * math.sin(latitude) ** 2
    return a * (1.0 - e2) / w**1.5 + height, a / math.sqrt(w) + height


def _is_thrusting(time_s: FloatArray, fits: tuple[Smoothed, Smoothed]) -> BoolArray:
    """Return when (n,) the speed changes as with an engine: gravity slows the climb, and drag only
    what is low.
    """
    speed = np.maximum(fits[0].at(time_s), 1.0)
    height = fits[1].at(time_s)
    gravity = _GRAVITY_M_S2 * (_EARTH_RADIUS_M / (_EARTH_RADIUS_M + height)) ** 2
    along = fits[0].at(time_s, 1) + gravity * np.clip(fits[1].at(time_s, 1) / speed, -1.0, 1.0)
    is_moving = fits[0].at(time_s) > 3.0
    return np.asarray(
        is_moving & (along > LEAST_THRUST_M_S2)
        | ((height > AIRLESS_M) & (along < -LEAST_THRUST_M_S2))
    )


def _burns_of_events(events: Mapping[str, float], grid: FloatArray) -> FloatArray | None:
    """Return the burns (k, 2) that events tell, None where they tell none."""
    first = float(grid[0])
    last = float(grid[-1])
    spans = []
    for start, end in _BURNS:
        if end in events and (not start or start in events):
            span = max(events[start] if start else max(first, 0.0), first), min(events[end], last)
            spans += [span] if span[1] - span[0] > 0.1 else []
        elif start and start in events and events[start] < last:
            spans.append((max(events[start], first), last))
    burns: list[tuple[float, float]] = []
    for span in sorted(spans):
        if burns and span[0] <= burns[-1][1]:
            burns[-1] = burns[-1][0], max(span[1], burns[-1][1])
        else:
            burns.append(span)
    return np.array(burns) if burns else None
