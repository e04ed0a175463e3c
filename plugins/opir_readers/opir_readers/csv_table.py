"""Tables of states as text: a line of column names with units, then one state per line."""

import math
import re
from collections.abc import Iterator, Mapping
from itertools import chain, islice

import numpy as np
from attrs import frozen

from opir_core.arrays import FloatArray
from opir_core.geometry import geodetic_to_ecef
from opir_core.plugin import BadFileError, StateTable
from opir_readers.celestial_frames import earth_rotation_m_s
from opir_readers.columns import (
    ALTITUDE,
    BURNING,
    DATE,
    DOWNRANGE,
    INERTIAL_VELOCITY,
    LOCAL,
    LOCAL_VELOCITY,
    PLACES,
    SCALES,
    TIME,
    VELOCITIES,
    Column,
    celestial_frame,
    columns_of,
    place_group,
    unix_s_of_scale,
    unread_note,
)
from opir_readers.configs_of_sites import SiteConfig
from opir_readers.csv_layout import Layout, table_layout
from opir_readers.detections.times import unix_ns
from opir_readers.flights.site import Site
from opir_readers.frames import along_axes, axes_at, to_ecef
from opir_readers.odd_dates import date_notes
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


@frozen
class _Table:
    """A text, its layout and the columns that are read, by quantity."""

    text: str
    layout: Layout
    columns: Mapping[str, Column]

    def line_of(self, row: int) -> int:
        return next(islice(self.layout.rows(self.text), row, None))[0]


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
    text, layout = table_layout(text, mapped.values())
    table = _Table(text, layout, columns_of(layout.names, layout.line, mapped))
    values = _values(table)
    count = len(next(iter(values.values())))
    if count < 2:
        raise BadFileError(f"has {count} state{'s' if count != 1 else ''}; at least 2 are needed")
    has_dates = _has_dates(table)
    notes = [*unread_note(table.layout.names, table.columns), *_date_notes(table, values)]
    time_s = _times_s(values, has_dates) + (-epoch_us * 1e-6 if has_dates else start_s)
    require_order(time_s, table.line_of, may_repeat=True)
    position = _positions(values, table.line_of, site)
    require_places(position, table.line_of)
    velocity = _velocities(values, position)
    require_velocities(velocity, table.line_of)
    place = place_group(values)
    frame = celestial_frame(place)
    if frame:
        if not has_dates:
            raise BadFileError(
                f"line {layout.line}: positions along inertial axes need dates: a column timestamp"
            )
        moving = np.zeros_like(position) if velocity is None else velocity
        position, moving = to_ecef(frame, position, moving, epoch_us, time_s)
        velocity = None if velocity is None else moving
    column_names = {quantity: column.name for quantity, column in table.columns.items()}
    return StateTable(
        time_s,
        position,
        velocity,
        _runs(time_s),
        _burns_s(time_s, values.get(BURNING, np.ones(count))),
        table.line_of,
        tuple(notes),
        column_names,
        has_dates,
        PLACES[place],
    )


def _runs(time_s: FloatArray) -> np.ndarray:
    """Return the numbers of the smooth runs (n,): a time that occurs twice begins one."""
    run = np.cumsum(np.diff(time_s, prepend=time_s[0] - 1.0) == 0.0)
    if run[-1] > MOST_BREAKS:
        raise BadFileError(
            f"has {run[-1]} times that occur twice; at most {MOST_BREAKS} points can be not smooth"
        )
    return run


def _positions(
    values: Mapping[str, FloatArray], line_of: LineOf, config: SiteConfig | None
) -> FloatArray:
    """Return positions (n, 3), m: ECEF or along the axes of a celestial frame."""
    place = place_group(values)
    if place == LOCAL:
        site = Site.of(config, "east, north and up count from the launch point")
        return site.of_local(*(values[name] for name in place))
    if "height" not in place:
        return _stacked(values, place)
    height = _heights(values, config)
    if place == DOWNRANGE:
        site = Site.of(config, "distances downrange count from the launch point", with_azimuth=True)
        return site.of_downrange(values["downrange"], height)
    require_angles(values["lat"], values["lon"], line_of)
    return geodetic_to_ecef(values["lat"], values["lon"], height)


def _stacked(values: Mapping[str, FloatArray], names: tuple[str, ...]) -> FloatArray:
    return np.stack([values[name] for name in names], axis=1)


def _heights(values: Mapping[str, FloatArray], config: SiteConfig | None) -> FloatArray:
    """Return heights above the ellipsoid (n,)."""
    if "height" in values:
        return values["height"]
    way = ""
    if "lat" in values:
        way = ", or for heights above the ellipsoid set columns: {height_m: …} with their name"
    site = Site.of(config, f"altitudes count from the launch point{way}")
    return values[ALTITUDE] + site.height_m


def _velocities(values: Mapping[str, FloatArray], position_m: FloatArray) -> FloatArray | None:
    """Return velocities over the rotating Earth (n, 3), m/s, along the axes of the positions, or
    None.
    """
    names = next((group for group in VELOCITIES if group[0] in values), None)
    if names is None:
        return None
    velocity = _stacked(values, names)
    if names == INERTIAL_VELOCITY:
        return velocity - earth_rotation_m_s(position_m)
    return along_axes(velocity, axes_at(position_m)) if names == LOCAL_VELOCITY else velocity


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


def _has_dates(table: _Table) -> bool:
    """Whether the times of a table are dates: a date, with a time of the day beside it or not, or a
    scale that counts from one. Other seconds beside dates count.
    """
    columns = table.columns
    if TIME not in columns:
        return True
    _, cells = next(table.layout.rows(table.text), (0, list[str]()))
    return (
        DATE in columns
        and ":" in cells[columns[TIME].place]
        and ":" not in cells[columns[DATE].place]
    )


def _date_notes(table: _Table, values: Mapping[str, FloatArray]) -> Iterator[str]:
    """Yield what the times of a scale may be instead."""
    if values.keys().isdisjoint((TIME, DATE)):
        scale = next(name for name in SCALES if name in values)
        yield from date_notes(scale, float(values[scale][0]), table.line_of(0))


def _times_s(values: Mapping[str, FloatArray], has_dates: bool) -> FloatArray:
    """Return times (n,), s: since 1970 of dates, else as they count."""
    if not has_dates:
        return values[TIME]
    if TIME in values:
        return values[DATE] + values[TIME]
    if DATE in values:
        return values[DATE]
    scale = next(name for name in SCALES if name in values)
    return np.array([unix_s_of_scale(scale, since_s) for since_s in values[scale].tolist()])


def _values(table: _Table) -> dict[str, FloatArray]:
    """Return the columns by quantity, in SI units and radians: read at once where all are plain
    numbers, else line by line, to say what is not."""
    columns = table.columns
    values = None if DATE in columns else _plain_numbers(table)
    if values is not None and BURNING in columns:
        burning = values[:, list(columns).index(BURNING)]
        values = values if np.isin(burning, (0.0, 1.0)).all() else None
    if values is None:
        rows = [_row(table, cells, line) for line, cells in table.layout.rows(table.text)]
        values = np.array(rows).reshape(-1, len(columns))
    with np.errstate(over="ignore"):
        return {
            name: values[:, place] * column.factor
            for place, (name, column) in enumerate(columns.items())
        }


def _plain_numbers(table: _Table) -> FloatArray | None:
    """Return the numbers (n, columns) below the names, or None where something else stands
    there.
    """
    layout = table.layout
    lines = layout.plain_lines(table.text)
    head = next(lines, None)
    if head is None or (layout.has_decimal_comma and layout.delimiter == ","):
        return None
    places = [column.place for column in table.columns.values()]
    is_all = len(places) == len(layout.names)
    try:
        values = np.loadtxt(
            chain([head], lines),
            delimiter=layout.delimiter.strip(" ") or None,
            comments=None,
            quotechar='"',
            ndmin=2,
            usecols=None if is_all else places,
        )
    except ValueError:
        return None
    if is_all:
        values = values[:, places] if values.shape[1] == len(places) else values[:0]
    return values if len(values) and np.isfinite(values).all() else None


def _row(table: _Table, cells: list[str], line: int) -> list[float]:
    layout = table.layout
    layout.require_width(cells, line)
    columns = table.columns.values()
    return [_number(column, cells[column.place], layout, line) for column in columns]


def _clock_s(sign: str, hours: str, minutes: str, seconds: str) -> float:
    size = 3600.0 * float(hours) + 60.0 * float(minutes) + float(seconds)
    return -1.0 * size if sign == "-" else size


def _number(column: Column, cell: str, layout: Layout, line: int) -> float:
    if column.quantity == DATE:
        moment = f"{cell.strip()} 00:00" if _DAY.fullmatch(cell.strip()) else cell
        return unix_ns(moment, f"line {line}: {column.name}") * 1e-9
    clock = _CLOCK.fullmatch(cell.strip()) if column.quantity == TIME else None
    if clock:
        return _clock_s(*clock.groups())
    why = ""
    try:
        value = layout.number(cell)
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
