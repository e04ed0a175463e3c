"""Exports of rocket simulators: OpenRocket, RocketPy and RASAero II, as CSV.

OpenRocket writes the names of columns in a comment, units as the user chose them, events as
comments among the rows, and altitudes above the launch point. RocketPy writes X towards east, Y
towards north, Z above sea level, or the variables that the user names. RASAero II writes feet,
altitude above the launch point, and distance along the flight.
"""

import math
import re
from collections.abc import Iterator, Mapping, Sequence

import numpy as np
from attrs import evolve, frozen

from opir_core.arrays import FloatArray, RowArray
from opir_core.geometry import geodetic_to_ecef
from opir_core.plugin import BadFileError, StateTable
from opir_readers.columns import Units, bare_name
from opir_readers.configs_of_sites import SiteConfig
from opir_readers.csv_layout import Layout, layout_of
from opir_readers.flights.burns import Span, joined_spans, spans_of, with_burns_of_acceleration
from opir_readers.flights.site import Site
from opir_readers.published import published
from opir_readers.states import MOST_BURNS, number_or_nan, rows_off_the_earth, single_run

_EVENT = re.compile(r"#\s*Event\s+(\w+)\s+occurred at t=\s*([-+.,\deE]+)\s*(?:s|sec|seconds)?")

_NAMES: Mapping[str, Sequence[str]] = {
    "time": ("time",),
    "altitude": ("altitude", "altitude agl", "altitude above ground level"),
    "height": ("z",),
    "east": ("position east of launch", "x"),
    "north": ("position north of launch", "y"),
    "lat": ("latitude",),
    "lon": ("longitude",),
    "distance": ("distance",),
    "thrust": ("thrust", "net thrust"),
}

_OPENROCKET = {"vertical velocity", "total velocity", "position east of launch", "lateral distance"}


#: Units as programs write them, in SI units and radians; "" is none.
UNITS: Units = published("units")["rocket simulators"]


@frozen(eq=False)
class NamedColumns:
    """Columns (n,) by quantity, in SI units, nan for what is no number; and their lines."""

    values: Mapping[str, FloatArray]
    lines: Sequence[int]

    def line_of(self, row: int) -> int:
        """Return the line of a row."""
        return self.lines[row]

    def taken(self, rows: RowArray) -> "NamedColumns":
        """Return some of the rows; raises `BadFileError` for fewer than 2."""
        if len(rows) < 2:
            raise BadFileError(f"has {len(rows)} states; at least 2 are needed")
        values = {name: column[rows] for name, column in self.values.items()}
        return NamedColumns(values, [self.lines[row] for row in rows.tolist()])


def is_openrocket(text: str) -> bool:
    """Whether a text is a table of OpenRocket: names in a comment, or events among the rows."""
    has_events = _EVENT.search(text[:20_000]) is not None
    is_commented = text.lstrip("\ufeff")[:1] == "#"
    heads = [names for names in names_of_head(text) if {"time", "altitude"} <= names]
    return any(has_events or (is_commented and names & _OPENROCKET) for names in heads)


def is_rasaero(text: str) -> bool:
    """Whether a text is a table of RASAero II."""
    return {"time", "stage", "altitude", "distance", "vel-v"} <= names_of_head(text, 1)[0]


def is_rocketpy(text: str) -> bool:
    """Whether a text is a table of RocketPy: names in a comment above all rows."""
    names = names_of_head(text, 1)[0]
    has_places = {"x", "y", "z"} <= names or {"latitude", "longitude"} <= names
    is_of_time = re.match(r"\ufeff?#\s*\"?time\b", text, re.IGNORECASE) is not None
    return is_of_time and "time" in names and has_places and not is_openrocket(text)


def rocket_table(text: str, program: str, site: SiteConfig | None, start_s: float) -> StateTable:
    """Return the flight of an export; burns by its events or thrust, else by its acceleration.

    Raises `BadFileError` for columns that make no places, or where these need a launch point that
    is not set.
    """
    columns = _in_order(named_columns(text, _NAMES))
    time_s = columns.values["time"]
    position, frame = _positions(columns, program, site)
    table = single_run(time_s, position, None, columns.line_of, frame=f"{program}: {frame}")
    burns = _burns_s(text, columns)
    shifted = evolve(
        table,
        time_s=time_s + start_s,
        burns_s=(table.burns_s if burns is None else burns) + start_s,
    )
    return with_burns_of_acceleration(shifted) if burns is None else shifted


def _in_order(columns: NamedColumns) -> NamedColumns:
    """Return the rows with numbers, each time once: simulators repeat a time where something
    happens.
    """
    numbers = [values for name, values in columns.values.items() if name != "thrust"]
    rows = np.flatnonzero(np.isfinite([*numbers, np.zeros(len(columns.lines))]).all(axis=0))
    time_s = columns.values.get("time", np.arange(len(columns.lines), dtype=np.float64))
    # A step below a microsecond is a repeated row: differences of positions over it are rounding.
    rows = rows[np.diff(time_s[rows], append=np.inf) > 1e-6] if len(rows) else rows
    columns = columns.taken(rows)
    if "time" not in columns.values:
        raise BadFileError("names no column Time")
    return columns


def _positions(
    columns: NamedColumns, program: str, config: SiteConfig | None
) -> tuple[FloatArray, str]:
    """Return positions (n, 3) in ECEF and the quantities that they are from."""
    values = columns.values
    has_places = {"lat", "lon"} <= values.keys()
    has_local = {"east", "north"} <= values.keys() and program != "RASAero"
    if not has_places and not has_local and "distance" not in values:
        raise BadFileError(
            "has no places: export latitude and longitude, or the positions east and north of the"
            " launch too"
        )
    if has_places and (config is None or not has_local):
        # RocketPy names the unit of latitudes, or none: degrees either way.
        for row in rows_off_the_earth(values["lat"], values["lon"]):
            raise BadFileError(
                f"line {columns.line_of(row)}: latitude and longitude are no place on the Earth"
            )
        height = _heights(values, 0.0 if config is None else config.height_m)
        level = "the launch point" if "altitude" in values else "sea level"
        words = f"latitude, longitude and altitude above {level}"
        return geodetic_to_ecef(values["lat"], values["lon"], height), words
    if has_local:
        site = Site.of(config, "its places count from the launch point")
        height = _heights(values, site.height_m)
        words = "east, north and altitude"
        return site.of_ground(values["east"], values["north"], height), words
    site = Site.of(config, "its distances count from the launch point", with_azimuth=True)
    height = _heights(values, site.height_m)
    return site.of_downrange(values["distance"], height), "distance downrange and altitude"


def _heights(values: Mapping[str, FloatArray], ground_m: float) -> FloatArray:
    """Return heights above the ellipsoid (n,): those above the ground, or above sea level, which is
    taken for it.
    """
    if "altitude" in values:
        return values["altitude"] + ground_m
    if "height" in values:
        return values["height"]
    raise BadFileError("has no altitude")


def _burns_s(text: str, columns: NamedColumns) -> FloatArray | None:
    """Return the burns (k, 2) by events, else by thrust; None where a file has neither.

    Thrust above 1 % of the highest is a burn.
    """
    spans = _spans_of_events(text)
    time_s = columns.values["time"]
    if not spans and "thrust" in columns.values:
        thrust = np.nan_to_num(columns.values["thrust"])
        starts, ends = spans_of(thrust > 0.01 * max(float(thrust.max()), 1e-9))
        ends = np.minimum(ends + 1, len(time_s) - 1)
        spans = list(zip(time_s[starts].tolist(), time_s[ends].tolist(), strict=True))
    clipped = [(max(start, float(time_s[0])), min(end, float(time_s[-1]))) for start, end in spans]
    burns = joined_spans((span for span in clipped if span[1] > span[0]), gap_s=1e-6)
    return np.array(burns[:MOST_BURNS]) if burns else None


def _spans_of_events(text: str) -> list[Span]:
    """Return burns from the events IGNITION (or LAUNCH) and BURNOUT, in order of time."""
    events = [
        (time_s, name)
        for name, time in _EVENT.findall(text)
        if math.isfinite(time_s := number_or_nan(time.replace(",", ".")))
    ]
    spans = []
    ignitions = list[float]()
    for time_s, name in sorted(events, key=lambda event: event[0]):
        if name == "IGNITION" or (name == "LAUNCH" and not ignitions):
            ignitions.append(time_s)
        elif name == "BURNOUT" and ignitions:
            spans.append((ignitions.pop(0), time_s))
    return spans


def names_of_head(text: str, lines: int = 60) -> list[set[str]]:
    """Return, for each of the first lines, the names in it without units, in lower case."""
    heads = [line.lstrip("\ufeff#% ").strip() for line in text.split("\n", lines)[:lines]]
    return [
        {bare_name(name.strip().strip('"'))[0] for name in re.split("[,;\t]", head)}
        for head in heads
    ]


def named_columns(text: str, names_of: Mapping[str, Sequence[str]]) -> NamedColumns:
    """Return columns of a table; `names_of` gives, by quantity, the names in lower case that it may
    have.

    Raises `BadFileError` where a unit is not known, or a table has no lines.
    """
    layout = layout_of(text)
    places = {}
    for place, name in enumerate(layout.names):
        bare, unit = bare_name(name)
        quantity = next((key for key, names in names_of.items() if bare in names), None)
        if quantity is None or quantity in places:
            continue
        if unit not in UNITS:
            raise BadFileError(
                f"line {layout.line}: {name!r} has the unit {unit!r}; known are"
                f" {', '.join(filter(None, UNITS))}"
            )
        places[quantity] = place, UNITS[unit]
    if not places:
        raise BadFileError(
            f"line {layout.line}: names no column that is read:"
            f" {', '.join(map(repr, layout.names[:12]))}"
        )
    rows = list(_rows(layout, text))
    with np.errstate(over="ignore"):
        values = {
            quantity: factor * np.array([_number(cells[place], layout) for _, cells in rows])
            for quantity, (place, factor) in places.items()
        }
    return NamedColumns(values, [line for line, _ in rows]).taken(np.arange(len(rows)))


def _rows(layout: Layout, text: str) -> Iterator[tuple[int, list[str]]]:
    for line, cells in layout.rows(text):
        if len(cells) < len(layout.names):
            raise BadFileError(
                f"line {line}: has {len(cells)} values; line {layout.line} names"
                f" {len(layout.names)} columns"
            )
        yield line, cells


def _number(cell: str, layout: Layout) -> float:
    try:
        return number_or_nan(layout.number(cell))
    except ValueError:
        return math.nan
