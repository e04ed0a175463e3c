"""Telemetry of launch webcasts: speed and altitude over time, with launch point and azimuth.

Speed is relative to the Earth, altitude above the launch point. Both are rounded: smoothing splines
are fitted to them, and a note gives the residuals. The climb is the rate of the altitude, the rest
of the speed is over the ground: along the azimuth of the launch, turned by the Earth's rotation
alone (no yaw steering, which no webcast shows). Where a boostback takes the speed over the ground
through its least, it turns round.
"""

import csv
import io
import json
import math
import re
from collections.abc import Callable, Iterator, Mapping, Sequence
from typing import Any, NamedTuple

import numpy as np
from attrs import Factory, frozen

from opir_core.arrays import BoolArray, FloatArray
from opir_core.constants import (
    EARTH_ECCENTRICITY_SQUARED,
    EARTH_EQUATORIAL_RADIUS_M,
    EARTH_ROTATION_RAD_S,
)
from opir_core.geometry import east_north_up_axes, geodetic_to_ecef, vector
from opir_core.plugin import BadFileError, StateTable
from opir_readers.flights.burns import (
    AIRLESS_M,
    LEAST_THRUST_M_S2,
    burns_s,
    joined_spans,
    spans_text,
)
from opir_readers.flights.coasting import misread_speeds
from opir_readers.flights.site import Site
from opir_readers.flights.smoothing import (
    Smoothed,
    rounding_sigma,
    smoothing_spline,
    speed_rounding_sigma,
)
from opir_readers.frames import along_axes
from opir_readers.states import MOST_BURNS, TELEMETRY

_EARTH_RADIUS_M = 6_371_000.0

#: The fewest values of speed and altitude.
_FEWEST = 20

#: Least noise of altitudes, m: displays jump and lag. Splines through six webcasts left 10 to 54.
_LEAST_SIGMA_M = 50.0
#: Least noise of speeds, m/s, below that of whole km/h.
_LEAST_SIGMA_M_S = 0.05

#: Events that begin and end a burn, by the names that published telemetry gives them.
_BURNS = (
    ("", "meco"),
    ("ses1", "seco1"),
    ("ses2", "seco2"),
    ("boostback_start", "boostback_end"),
    ("entry_start", "entry_end"),
    ("landing_start", "landing_end"),
)
_EVENTS = {name for pair in _BURNS for name in pair if name}

_NAMES = {
    "time": ("time", "t", "time_s", "seconds"),
    "speed": ("velocity", "speed", "velocity_m_s", "speed_m_s", "speed_km_h", "velocity_km_h"),
    "altitude": ("altitude", "altitude_km", "altitude_m", "height_km"),
}

#: Objects with time, speed and altitude.
Points = list[Mapping[str, Any]]


@frozen(eq=False)
class Telemetry:
    """Times (n,), s, speeds, m/s, and altitudes, m, nan for missing ones; and times of events, s,
    by name. `notes` are what a user should know of them.
    """

    time_s: FloatArray
    speed_m_s: FloatArray
    height_m: FloatArray
    events: Mapping[str, float] = Factory(dict)
    notes: tuple[str, ...] = ()


class _Curves(NamedTuple):
    """Splines of speed and altitude."""

    speed: Smoothed
    height: Smoothed

    def level_and_climb(self, time_s: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return speeds over the ground and of climb (n,), m/s."""
        speed = np.maximum(self.speed.at(time_s), 0.0)
        climb = np.clip(self.height.at(time_s, 1), -speed, speed)
        return np.sqrt(speed * speed - climb * climb), climb


def is_webcast(text: str) -> bool:
    """Whether a text is JSON or CSV of time, speed and altitude, and of no places."""
    head = text[:4000].lstrip()
    if head[:1] in ("{", "["):
        beginning = text[:800_000]
        has_speed = re.search(r'"(velocity|speed)"', beginning) is not None
        return '"altitude"' in beginning and has_speed
    names = {name.strip().strip('"').lower() for name in head.partition("\n")[0].split(",")}
    return (
        len(names) >= 3
        and all(names.intersection(choice) for choice in _NAMES.values())
        and not any("lat" in name for name in names)
    )


def webcast_table(text: str, site: Site, start_s: float) -> StateTable:
    """Return the flight of a text, with velocities; the noise is that of the rounding of its
    numbers.

    Raises `BadFileError`.
    """
    telemetry = _in_order(_telemetry(text))
    time_s = telemetry.time_s
    complaint = misread_speeds(time_s, telemetry.speed_m_s, telemetry.height_m)
    if complaint:
        raise BadFileError(complaint)
    speed, note = _fit(
        "speed", "m/s", time_s, telemetry.speed_m_s, speed_rounding_sigma, _LEAST_SIGMA_M_S
    )
    notes = [*telemetry.notes, note]
    height, note = _fit("altitude", "m", time_s, telemetry.height_m, rounding_sigma, _LEAST_SIGMA_M)
    notes.append(note)
    curves = _Curves(speed, height)
    grid = _grid(telemetry)
    position, velocity = _path(grid, curves, site, _turn_s(grid, curves, telemetry.events))
    burns = _burns_of_events(telemetry.events, grid)
    if burns is None:
        burns = _burns_of_acceleration(grid, curves)
        notes.append(f"burns by acceleration: {spans_text(burns)}")
    return StateTable(
        grid + start_s,
        position,
        velocity,
        np.zeros(len(grid), dtype=np.int64),
        burns[:MOST_BURNS] + start_s,
        lambda _row: 1,
        tuple(notes),
        frame=TELEMETRY,
    )


def _telemetry(text: str) -> Telemetry:
    if text.lstrip()[:1] not in ("{", "["):
        return _of_csv(text)
    events: dict[str, float] = {}
    stages: dict[str, Points] = {}
    for value in list(_json_values(text)):
        _take(value, stages, events)
    if not stages:
        raise BadFileError("has no time, velocity and altitude")
    points, notes = _longest(stages)
    names = ("time", "velocity" if "velocity" in points[0] else "speed", "altitude")
    rows = [[_number(point.get(name)) for name in names] for point in points]
    time_s, speed, height = np.array(rows).reshape(-1, 3).T
    return Telemetry(time_s, speed, _in_metres(height), events, notes)


def _longest(stages: Mapping[str, Points]) -> tuple[Points, tuple[str, ...]]:
    """Return the points of the stage that is shown longest, after those of the stages that carried
    it before; and a note where others fly on.
    """
    times = {
        name: [_number(point.get("time")) for point in points] for name, points in stages.items()
    }
    taken = max(times, key=lambda name: float(np.fmax.reduce(times[name])))
    first_s = np.fmin.reduce(times[taken])
    others = [name for name in stages if name != taken]
    before = [
        point
        for name in others
        for point, time_s in zip(stages[name], times[name], strict=True)
        if time_s < first_s
    ]
    left_out = [repr(name) for name in others if np.fmax.reduce(times[name]) >= first_s]
    note = f"of several stages {taken!r} is taken, the longest; not {', '.join(left_out)}"
    return [*before, *stages[taken]], (note,) if left_out else ()


def _in_metres(altitude: FloatArray) -> FloatArray:
    """Return altitudes (n,), m, of those without a unit: published telemetry gives kilometres, and
    no ascent stays below 5 km.
    """
    highest = np.nanmax(np.abs(altitude), initial=0.0)
    return altitude * 1e3 if highest < 5000.0 else altitude


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
    value: Any,
    stages: dict[str, Points],
    events: dict[str, float],
    stage: str = "",
    depth: int = 0,
) -> None:
    """Add the points by stage, and the events, of a JSON value: of arrays by name, of objects, of
    lists of either.
    """
    if depth > 6 or not isinstance(value, list | dict):
        return
    inner = [(stage, item) for item in value]
    if isinstance(value, dict):
        events |= _events_of(value)
        inner = []
        stage = f"stage {value['stage']}" if "stage" in value else stage
        names = ("time", "velocity" if "velocity" in value else "speed", "altitude")
        columns = [value.get(name) for name in names]
        if all(isinstance(column, list) for column in columns):
            rows = zip(*columns, strict=False)
            points = [dict(zip(names, row, strict=True)) for row in rows]
            stages.setdefault(stage, []).extend(points)
        elif "time" in value and columns[1] is not None:
            stages.setdefault(stage, []).append(value)
        else:
            inner = [
                (key if key.startswith("stage") else stage, item) for key, item in value.items()
            ]
    for name, item in inner:
        _take(item, stages, events, name, depth + 1)


def _events_of(value: Mapping[str, Any]) -> dict[str, float]:
    """Return the times of events, s, of an object."""
    times = {name: _number(value.get(name)) for name in _EVENTS}
    return {name: time_s for name, time_s in times.items() if math.isfinite(time_s)}


def _number(value: Any) -> float:
    """Return a number of JSON, nan for anything else and for integers beyond the largest number."""
    if not isinstance(value, int | float) or isinstance(value, bool):
        return math.nan
    try:
        return float(value)
    except OverflowError:
        return math.nan


def _of_csv(text: str) -> Telemetry:
    reader = csv.reader(io.StringIO(text))
    try:
        rows = [row for row in reader if row and not row[0].lstrip().startswith("#")]
    except csv.Error as error:
        raise BadFileError(f"line {reader.line_num}: not CSV: {error}") from error
    names = [name.strip().lower() for name in rows[0]] if rows else []
    choices = _NAMES.values()
    columns = [next((name for name in choice if name in names), "") for choice in choices]
    if not all(columns):
        raise BadFileError("line 1: names no time, speed and altitude")
    places = [names.index(name) for name in columns]
    values = np.array([[_cell(row, place) for place in places] for row in rows[1:]]).reshape(-1, 3)
    time_s, speed, height = values.T
    if columns[1].endswith("_km_h"):
        speed = speed / 3.6
    if columns[2].endswith("_km"):
        height = height * 1e3
    return Telemetry(time_s, speed, _in_metres(height) if columns[2] == "altitude" else height)


def _cell(row: Sequence[str], place: int) -> float:
    try:
        return float(row[place])
    except (IndexError, ValueError):
        return math.nan


def _in_order(telemetry: Telemetry) -> Telemetry:
    """Return the rows with a time and a number, each time once; raises `BadFileError` for too few,
    and for numbers in other units.
    """
    time_s = telemetry.time_s
    speed = telemetry.speed_m_s
    height = telemetry.height_m
    is_row = np.isfinite(time_s) & (np.isfinite(speed) | np.isfinite(height))
    rows = np.flatnonzero(is_row)
    rows = rows[np.unique(time_s[rows], return_index=True)[1]]
    time_s = time_s[rows]
    speed = speed[rows]
    height = height[rows]
    if min(np.count_nonzero(np.isfinite(values)) for values in (speed, height)) < _FEWEST:
        raise BadFileError(
            f"has {len(rows)} rows with time, speed and altitude; at least {_FEWEST} are needed"
        )
    # The states are as many as the splines are long, not as the file has rows.
    if time_s[-1] - time_s[0] > 30.0 * len(rows):
        raise BadFileError(
            f"has {len(rows)} rows over {time_s[-1] - time_s[0]:.6g} s; are its times in other"
            " units? give seconds"
        )
    extremes = [np.nanmax(np.abs(values)) for values in (speed, height, time_s)]
    if (np.array(extremes) > (2e4, 1e7, 1e6)).any():
        raise BadFileError(
            "has speeds above 20 km/s, altitudes above 10 000 km or times beyond a million seconds;"
            " check the units"
        )
    return Telemetry(time_s, speed, height, telemetry.events, telemetry.notes)


def _fit(
    name: str,
    unit: str,
    time_s: FloatArray,
    values: FloatArray,
    rounding: Callable[[FloatArray], FloatArray],
    least: float,
) -> tuple[Smoothed, str]:
    """Return the spline of a column and a note for the user; the noise is that of the rounding, and
    no webcast is better than the least.
    """
    rows = np.isfinite(values)
    sigma = np.maximum(rounding(values[rows]), least)
    fit = smoothing_spline(time_s[rows], values[rows], sigma)
    outliers = f", {fit.outliers} left out" if fit.outliers else ""
    extremes = " to ".join(f"{value:.3g}" for value in np.unique([sigma.min(), sigma.max()]))
    note = (
        f"{name} smoothed to a noise of {extremes} {unit}: {fit.residual:.3g} {unit} rms"
        f" left{outliers}"
    )
    return fit, note


def _grid(telemetry: Telemetry) -> FloatArray:
    """Return the times of the states: every second, and those of the events."""
    start = float(telemetry.time_s[0])
    end = float(telemetry.time_s[-1])
    count = max(math.ceil(end - start), 2)
    inside = [time for time in telemetry.events.values() if start < time < end]
    grid = np.unique(np.concatenate([np.linspace(start, end, count + 1), inside]))
    return grid[np.diff(grid, prepend=-np.inf) > 1e-3]


def _turn_s(time_s: FloatArray, curves: _Curves, events: Mapping[str, float]) -> float:
    """Return when a boostback turns the flight round, inf where none does: where the speed over the
    ground is least.
    """
    start, end = (events.get(f"boostback_{edge}", math.inf) for edge in ("start", "end"))
    during = time_s[(time_s >= start) & (time_s <= end)]
    if len(during) < 3:
        return math.inf
    level, _ = curves.level_and_climb(during)
    least = int(level.argmin())
    return float(during[least]) if level[-1] > 1.2 * level[least] else math.inf


def _path(
    time_s: FloatArray, curves: _Curves, site: Site, turn_s: float
) -> tuple[FloatArray, FloatArray]:
    """Return positions and velocities (n, 3) in ECEF: climb by the altitude, the rest of the speed
    over the ground.
    """
    fine_s = np.linspace(time_s[0], time_s[-1], 4 * len(time_s) + 1)
    track = _ground_track(fine_s, curves, site, turn_s)
    latitude, longitude, heading = (np.interp(time_s, fine_s, values) for values in track)
    level, climb = _level_and_climb(time_s, curves, turn_s)
    height = np.maximum(curves.height.at(time_s), 0.0) + site.height_m
    local = vector(level * np.sin(heading), level * np.cos(heading), climb)
    velocity = along_axes(local, east_north_up_axes(latitude, longitude))
    return geodetic_to_ecef(latitude, longitude, height), velocity


def _level_and_climb(
    time_s: FloatArray, curves: _Curves, turn_s: float
) -> tuple[FloatArray, FloatArray]:
    """Return speeds over the ground, negative once the flight has turned, and of climb (n,),
    m/s.
    """
    level, climb = curves.level_and_climb(time_s)
    return np.where(time_s < turn_s, level, -level), climb


def _ground_track(time_s: FloatArray, curves: _Curves, site: Site, turn_s: float) -> FloatArray:
    """Return latitudes, longitudes and headings (3, n), rad, at even times along a path that only
    the Earth's rotation turns.

    Over the rotating Earth the heading of what no side force acts on turns by the Coriolis
    acceleration across it, 2 Ω (v sin φ - climb cos φ cos ψ) / v, and by the convergence of
    meridians, v sin ψ tan φ / r.
    """
    level, climb = _level_and_climb(time_s, curves, turn_s)
    height = curves.height.at(time_s)
    latitude = site.latitude_rad
    longitude = site.longitude_rad
    heading = site.azimuth_rad
    track = [(latitude, longitude, heading)]
    step = float(time_s[1] - time_s[0])
    rows = np.stack([level, climb, height], axis=1)[:-1].tolist()
    for v, up, h in rows:
        cosine = max(math.cos(latitude), 1e-6)
        turn = 0.0
        if cosine > 1e-3:
            turn = v * math.sin(heading) * math.tan(latitude) / (_EARTH_RADIUS_M + h)
        if abs(v) > max(up, 100.0) or abs(v) > 500.0:
            across = math.sin(latitude) - up / v * cosine * math.cos(heading)
            turn += 2.0 * EARTH_ROTATION_RAD_S * across
        north, prime = _radii(latitude, h)
        latitude += v * math.cos(heading) / north * step
        longitude += v * math.sin(heading) / (prime * cosine) * step
        heading += turn * step
        latitude = min(max(latitude, -0.5 * math.pi), 0.5 * math.pi)
        track.append((latitude, longitude, heading))
    return np.array(track).T


def _radii(latitude: float, height: float) -> tuple[float, float]:
    """Return the radii of curvature of meridian and prime vertical at a height, m."""
    a = EARTH_EQUATORIAL_RADIUS_M
    e2 = EARTH_ECCENTRICITY_SQUARED
    w = 1.0 - e2 * math.sin(latitude) ** 2
    return a * (1.0 - e2) / w**1.5 + height, a / math.sqrt(w) + height


def _burns_of_acceleration(time_s: FloatArray, curves: _Curves) -> FloatArray:
    burns = burns_s(time_s, _is_thrusting(time_s, curves))
    if not len(burns):
        raise BadFileError("shows no acceleration of a burn; are speeds in other units?")
    return burns


def _is_thrusting(time_s: FloatArray, curves: _Curves) -> BoolArray:
    """Return when (n,) the speed changes as with an engine: gravity slows the climb, and drag only
    low flight.
    """
    speed = curves.speed.at(time_s)
    height = curves.height.at(time_s)
    gravity = 9.81 * (_EARTH_RADIUS_M / (_EARTH_RADIUS_M + height)) ** 2
    sine = np.clip(curves.height.at(time_s, 1) / np.maximum(speed, 1.0), -1.0, 1.0)
    along = curves.speed.at(time_s, 1) + gravity * sine
    is_driven = (speed > 3.0) & (along > LEAST_THRUST_M_S2)
    is_braked = (height > AIRLESS_M) & (along < -LEAST_THRUST_M_S2)
    return is_driven | is_braked


def _burns_of_events(events: Mapping[str, float], grid: FloatArray) -> FloatArray | None:
    """Return the burns (k, 2) that events report, None without any."""
    begin = float(grid[0])
    end = float(grid[-1])
    spans = []
    for ignition, burnout in _BURNS:
        start_s = max(events.get(ignition, 0.0 if not ignition else math.inf), begin)
        if burnout in events and math.isfinite(start_s):
            end_s = min(events[burnout], end)
            spans += [(start_s, end_s)] if end_s - start_s > 0.1 else []
        elif ignition in events and events[ignition] < end:
            spans.append((start_s, end))
    burns = joined_spans(spans, gap_s=0.0)
    return np.array(burns) if burns else None
