"""Tables of states as text: a line of column names with units, then one state per line."""

import math
import re
from collections.abc import Mapping
from itertools import chain, islice

import numpy as np

from opir_core.arrays import FloatArray
from opir_core.constants import EARTH_ROTATION_RAD_S
from opir_core.geometry import east_north_up_axes, ecef_to_geodetic, geodetic_to_ecef
from opir_core.plugin import BadFileError, StateTable
from opir_readers.columns import (
    ALTITUDE,
    BURNING,
    CELESTIAL,
    DATE,
    PLACES,
    SCALES,
    TIME,
    VELOCITIES,
    Column,
    columns_of,
    place_group,
    unix_s_of_scale,
    unread,
)
from opir_readers.configs_of_sites import SiteConfig
from opir_readers.csv_layout import Layout, decimal, layout_of, with_dates_named
from opir_readers.detections.times import unix_ns
from opir_readers.flights.site import Site
from opir_readers.frames import to_ecef
from opir_readers.json_text import table_of_json
from opir_readers.states import (
    MOST_BURNS,
    LineOf,
    require_angles,
    require_order,
    require_places,
    require_velocities,
)

#: The most points where the motion is not smooth: each costs as much as a hundred states.
MOST_BREAKS = 10_000

#: Elapsed times and times of the day, 00:01:10.5 or T+00:01:10.
_CLOCK = re.compile(r"T?\s*([+-]?)(\d{1,3}):(\d\d):(\d\d(?:\.\d*)?)", re.IGNORECASE)

#: A date without a time, which begins its day.
_DAY = re.compile(r"[\d./-]{8,10}")

#: The most names of columns that are listed.
_LISTED = 6


def csv_table(
    text: str,
    start_s: float,
    columns: Mapping[str, str] | None = None,
    site: SiteConfig | None = None,
    epoch_us: int = 0,
) -> StateTable:
    """Return the table of a text whose time 0 is the scene time `start_s`; dates count from the
    scene's epoch.

    Columns, in any order, parted by commas, semicolons, tabs, bars or blanks: the time; the place,
    as ECEF, as geodetic latitude, longitude and height, in EME2000 or TEME, or from a launch point
    `site`; perhaps the velocity; and is_burning: 1 where the plume radiates from this line's time
    to the next, else 0. Names have their units (`opir_readers.columns`), or `columns` maps
    quantities to names. Lines that begin with #, % or // are comments. A time that occurs twice in
    a row marks a point where the motion is not smooth, as a change of stages. JSON is read as the
    table of its records. Raises `BadFileError`.
    """
    mapped = columns or {}
    text = table_of_json(text) or text
    layout = with_dates_named(layout_of(text, mapped.values()), text, mapped.values())
    known = columns_of(layout.names, layout.line, mapped)
    values, has_dates = _with_times(_values(text, layout, known), known, layout, text)
    values[TIME] += -epoch_us * 1e-6 if has_dates else start_s
    count = len(values[TIME])
    if count < 2:
        raise BadFileError(f"has {count} state{'s' if count != 1 else ''}; at least 2 are needed")
    time_s = values[TIME]

    def line_of(row: int) -> int:
        return next(islice(layout.rows(text), row, None))[0]

    require_order(time_s, line_of, may_repeat=True)
    position = _positions(values, line_of, site)
    require_places(position, line_of)
    velocity = _velocities(values, position)
    require_velocities(velocity, line_of)
    group = place_group(known)
    if group in CELESTIAL:
        if not has_dates:
            raise BadFileError(
                f"line {layout.line}: positions along inertial axes need dates: a column timestamp"
            )
        moving = np.zeros_like(position) if velocity is None else velocity
        position, moving = to_ecef(CELESTIAL[group], position, moving, epoch_us, time_s)
        velocity = None if velocity is None else moving
    run = np.cumsum(np.diff(time_s, prepend=time_s[0] - 1.0) == 0.0)
    if run[-1] > MOST_BREAKS:
        raise BadFileError(
            f"has {run[-1]} times that occur twice; at most {MOST_BREAKS} points can be not smooth"
        )
    burns_s = _burns_s(time_s, values.get(BURNING, np.ones(count)))
    names = {quantity: column.name for quantity, column in known.items()}
    frame = _FRAMES[group]
    return StateTable(
        time_s,
        position,
        velocity,
        run,
        burns_s,
        line_of,
        _notes(layout, known),
        names,
        has_dates,
        frame,
    )


def _notes(layout: Layout, known: Mapping[str, Column]) -> tuple[str, ...]:
    left = unread(layout.names, known)
    more = f" and {len(left) - _LISTED} more" if len(left) > _LISTED else ""
    return (
        (f"columns that are not read: {', '.join(map(repr, left[:_LISTED]))}{more}",)
        if left
        else ()
    )


_FRAMES = dict(
    zip(
        PLACES,
        (
            "ECEF",
            "latitude, longitude, height above WGS 84",
            "east, north and up from the launch point",
            "distance downrange and height from the launch point",
            "EME2000",
            "TEME",
        ),
        strict=True,
    )
)


def _positions(
    values: Mapping[str, FloatArray], line_of: LineOf, config: SiteConfig | None
) -> FloatArray:
    """Return ECEF positions (n, 3), m."""
    group = place_group(values)
    if group == PLACES[0] or group in CELESTIAL:
        return np.stack([values[name] for name in group], axis=1)
    if group == PLACES[2]:
        return Site.of(config, "east, north and up count from the launch point").of_local(
            *(values[name] for name in group)
        )
    height = _heights(values, config)
    if group == PLACES[3]:
        site = Site.of(config, "distances downrange count from the launch point", with_azimuth=True)
        return site.of_downrange(values["downrange"], height)
    latitude = values["lat"]
    longitude = values["lon"]
    require_angles(latitude, longitude, line_of)
    return geodetic_to_ecef(latitude, longitude, height)


def _heights(values: Mapping[str, FloatArray], config: SiteConfig | None) -> FloatArray:
    """Return heights above the ellipsoid (n,)."""
    if "height" in values:
        return values["height"]
    is_place = "lat" in values
    way = (
        ", or for heights above the ellipsoid set columns: {height_m: …} with their name"
        if is_place
        else ""
    )
    return (
        values[ALTITUDE] + Site.of(config, f"altitudes count from the launch point{way}").height_m
    )


def _velocities(values: Mapping[str, FloatArray], position_m: FloatArray) -> FloatArray | None:
    """Return velocities over the rotating Earth in ECEF (n, 3), m/s, or None."""
    names = next((group for group in VELOCITIES if group[0] in values), None)
    if names is None:
        return None
    velocity = np.stack([values[name] for name in names], axis=1)
    if names == VELOCITIES[1]:
        return over_the_ground(velocity, position_m)
    return from_local_axes(velocity, position_m) if names == VELOCITIES[2] else velocity


def over_the_ground(inertial_m_s: FloatArray, position_m: FloatArray) -> FloatArray:
    """Return velocities over the rotating Earth (n, 3) of inertial ones along the axes of ECEF."""
    x = position_m[:, 0]
    y = position_m[:, 1]
    return inertial_m_s - EARTH_ROTATION_RAD_S * np.stack([-y, x, np.zeros_like(x)], axis=1)


def from_local_axes(velocity_m_s: FloatArray, position_m: FloatArray) -> FloatArray:
    """Return velocities (n, 3) in ECEF of those towards east, north and up at each position."""
    where = ecef_to_geodetic(position_m)
    axes = east_north_up_axes(where.latitude_rad, where.longitude_rad)
    return np.asarray((velocity_m_s[:, :, None] * axes).sum(axis=1))


def _burns_s(time_s: FloatArray, is_burning: FloatArray) -> FloatArray:
    """Return the burns (k, 2) of states at times (n,): each from a line with 1 to the next line
    with 0, or the last.
    """
    edge = np.diff(np.concatenate([[0.0], is_burning[:-1], [0.0]]))
    burns_s = np.stack([time_s[edge > 0.0], time_s[edge < 0.0]], axis=-1)
    # A time that occurs twice may end one burn and begin the next, or hold a burn of no length.
    burns_s = burns_s[burns_s[:, 0] < burns_s[:, 1]]
    if not len(burns_s):
        raise BadFileError(
            f"{BURNING} is 0 throughout; 1 says that the plume radiates up to the next line's time"
        )
    if len(burns_s) > MOST_BURNS:
        raise BadFileError(
            f"{BURNING} begins {len(burns_s)} burns; at most {MOST_BURNS} are possible"
        )
    return burns_s


def _with_times(
    values: dict[str, FloatArray], known: Mapping[str, Column], layout: Layout, text: str
) -> tuple[dict[str, FloatArray], bool]:
    """Return the columns with their times, s since 1970 for dates and else as they count, and
    whether they are dates.

    A time of the day beside a date is added to it; other seconds beside dates count.
    """
    scale = next((name for name in SCALES if name in known), None)
    if TIME in known:
        _, cells = next(layout.rows(text), (0, []))
        is_clock = (
            DATE in known
            and ":" in cells[known[TIME].place]
            and ":" not in cells[known[DATE].place]
        )
        return (values | {TIME: values[DATE] + values[TIME]} if is_clock else values), is_clock
    if DATE in known or scale is None:
        return values | {TIME: values[DATE]}, True
    return values | {
        TIME: np.array([unix_s_of_scale(scale, since_s) for since_s in values[scale].tolist()])
    }, True


def _values(text: str, layout: Layout, known: Mapping[str, Column]) -> dict[str, FloatArray]:
    """Return the columns by quantity, in SI units and radians: read at once where all are plain
    numbers, else line by line, to say what is not."""
    values = None if DATE in known else _plain_numbers(text, layout, known)
    if values is not None and BURNING in known:
        burning = values[:, list(known).index(BURNING)]
        values = values if ((burning == 0.0) | (burning == 1.0)).all() else None
    if values is None:
        rows = [_row(known, layout, cells, line) for line, cells in layout.rows(text)]
        values = np.array(rows).reshape(-1, len(known))
    with np.errstate(over="ignore"):
        return {
            name: values[:, place] * column.factor
            for place, (name, column) in enumerate(known.items())
        }


def _plain_numbers(text: str, layout: Layout, known: Mapping[str, Column]) -> FloatArray | None:
    """Return the numbers (n, columns) below the names, or None where something else stands
    there.
    """
    if layout.has_decimal_comma and layout.delimiter == ",":
        return None
    lines = layout.plain_lines(text)
    first = next(lines, None)
    if first is None:
        return None
    places = [column.place for column in known.values()]
    is_whole = len(places) == len(layout.names)
    try:
        values = np.loadtxt(
            chain([first], lines),
            delimiter=layout.delimiter.strip(" ") or None,
            comments=None,
            quotechar='"',
            ndmin=2,
            usecols=None if is_whole else places,
        )
    except ValueError:
        return None
    if is_whole:
        values = values[:, places] if values.shape[1] == len(places) else values[:0]
    return values if len(values) and np.isfinite(values).all() else None


def _row(known: Mapping[str, Column], layout: Layout, cells: list[str], line: int) -> list[float]:
    extra = cells[len(layout.names) :]
    if len(cells) < len(layout.names) or any(cell.strip() for cell in extra):
        raise BadFileError(
            f"line {line}: has {len(cells)} values; the first line names {len(layout.names)}"
            f" columns"
        )
    return [_number(column, cells[column.place], layout, line) for column in known.values()]


def _number(column: Column, cell: str, layout: Layout, line: int) -> float:
    if column.quantity == DATE:
        moment = f"{cell.strip()} 00:00" if _DAY.fullmatch(cell.strip()) else cell
        return unix_ns(moment, f"line {line}: {column.name}") * 1e-9
    clock = _CLOCK.fullmatch(cell.strip()) if column.quantity == TIME else None
    if clock:
        hours, minutes, seconds = (float(clock[number]) for number in (2, 3, 4))
        return (-1.0 if clock[1] == "-" else 1.0) * (3600.0 * hours + 60.0 * minutes + seconds)
    why = ""
    try:
        value = decimal(cell, layout)
    except ValueError as error:
        value = math.nan
        why = f": it {error}" if "separators" in str(error) else ""
    if not math.isfinite(value):
        raise BadFileError(
            f"line {line}: {column.name} is {cell.strip()!r}, not a finite number{why}"
        )
    if column.quantity == BURNING and value not in (0.0, 1.0):
        raise BadFileError(f"line {line}: {column.name} is {cell.strip()!r}; 0 or 1 is needed")
    return value
