"""Exports of rocket simulators: OpenRocket, RocketPy and RASAero II, as CSV.

OpenRocket writes the names of columns in a comment, units as the user chose them, events as
comments among the rows, and altitudes above the launch point. RocketPy writes X towards east, Y
towards north, Z above sea level, or the variables that the user names. RASAero II writes feet,
altitude above the launch point, and distance along the flight.
"""

import re
from collections.abc import Mapping, Sequence

import numpy as np

from opir_core.arrays import BoolArray, FloatArray
from opir_core.geometry import geodetic_to_ecef
from opir_core.plugin import BadFileError, StateTable
from opir_readers.configs_of_sites import SiteConfig
from opir_readers.flights.burns import with_burns_of_acceleration
from opir_readers.flights.named_columns import NamedColumns, named_columns, names_of_head
from opir_readers.flights.site import Site
from opir_readers.states import MOST_BURNS, require_order, require_places

_EVENT = re.compile(r"#\s*Event\s+(\w+)\s+occurred at t=\s*([-+.,\deE]+)\s*(?:s|sec|seconds)?")

_WANTED: Mapping[str, Sequence[str]] = {
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

#: Thrust above this share of the highest is a burn.
_LIT = 0.01


_OPENROCKET = {"vertical velocity", "total velocity", "position east of launch", "lateral distance"}


def is_openrocket(text: str) -> bool:
    """Return whether a text is a table of OpenRocket: names in a comment, or events among the
    rows.
    """
    has_events = _EVENT.search(text[:20_000]) is not None
    is_commented = text.lstrip("\ufeff")[:1] == "#"
    heads = [names for names in names_of_head(text) if {"time", "altitude"} <= names]
    return any(has_events or (is_commented and names & _OPENROCKET) for names in heads)


def is_rasaero(text: str) -> bool:
    """Return whether a text is a table of RASAero II."""
    return {"time", "stage", "altitude", "distance", "vel-v"} <= names_of_head(text, 1)[0]


def is_rocketpy(text: str) -> bool:
    """Return whether a text is a table of RocketPy: names in a comment above all rows."""
    names = names_of_head(text, 1)[0]
    has_places = {"x", "y", "z"} <= names or {"latitude", "longitude"} <= names
    is_of_time = re.match(r"\ufeff?#\s*\"?time\b", text, re.IGNORECASE) is not None
    return is_of_time and "time" in names and has_places and not is_openrocket(text)


def rocket_table(text: str, program: str, site: SiteConfig | None, start_s: float) -> StateTable:
    """Return the flight of an export; burns by its events or thrust, else by its acceleration.

    Raises `BadFileError` for columns that make no places, or where these need a launch point that
    is not set.
    """
    columns = named_columns(text, _WANTED)
    columns = _in_order(columns)
    if "time" not in columns.values:
        raise BadFileError("names no column Time")
    position, frame = _positions(columns, program, site)
    time_s = columns.values["time"]
    require_order(time_s, columns.line_of, may_repeat=False)
    require_places(position, columns.line_of)
    burns = _burns(text, columns)
    given = np.array([[time_s[0], time_s[-1]]]) if burns is None else burns
    run = np.zeros(len(time_s), dtype=np.int64)
    table = StateTable(
        time_s + start_s,
        position,
        None,
        run,
        given + start_s,
        columns.line_of,
        frame=f"{program}: {frame}",
    )
    return with_burns_of_acceleration(table) if burns is None else table


def _in_order(columns: NamedColumns) -> NamedColumns:
    """Return the rows with numbers, each time once: simulators repeat a time where something
    happens.
    """
    good: BoolArray = np.ones(len(columns.lines), dtype=bool)
    for name, values in columns.values.items():
        if name != "thrust":
            good &= np.isfinite(values)
    time_s = columns.values.get("time", np.arange(len(good), dtype=np.float64))
    rows = np.flatnonzero(good)
    # A step below a microsecond is a repeated row: differences of positions over it are rounding.
    rows = rows[np.diff(time_s[rows], append=np.inf) > 1e-6] if len(rows) else rows
    if len(rows) < 2:
        raise BadFileError(f"has {len(rows)} states; at least 2 are needed")
    return NamedColumns(
        {name: values[rows] for name, values in columns.values.items()},
        [columns.lines[row] for row in rows.tolist()],
    )


def _positions(
    columns: NamedColumns, program: str, config: SiteConfig | None
) -> tuple[FloatArray, str]:
    """Return positions (n, 3) in ECEF and what they are from."""
    values = columns.values
    has_places = {"lat", "lon"} <= values.keys()
    has_local = {"east", "north"} <= values.keys() and program != "RASAero"
    if not has_places and not has_local and "distance" not in values:
        raise BadFileError(
            "has no places: export latitude and longitude, or the positions east and north of the"
            " launch too"
        )
    if has_places and (config is None or not has_local):
        _require_degrees(columns)
        ground = 0.0 if config is None else config.height_m
        height = _heights(values, ground)
        where = "latitude, longitude and altitude above " + (
            "the launch point" if "altitude" in values else "sea level"
        )
        return geodetic_to_ecef(values["lat"], values["lon"], height), where
    if has_local:
        site = Site.of(config, "its places count from the launch point")
        return site.of_ground(
            values["east"], values["north"], _heights(values, site.height_m)
        ), "east, north and altitude"
    site = Site.of(config, "its distances count from the launch point", with_azimuth=True)
    return site.of_downrange(
        values["distance"], _heights(values, site.height_m)
    ), "distance downrange and altitude"


def _heights(values: Mapping[str, FloatArray], ground_m: float) -> FloatArray:
    """Return heights above the ellipsoid (n,): those above the ground, or above sea level, which is
    taken for it.
    """
    if "altitude" in values:
        return np.asarray(values["altitude"] + ground_m)
    if "height" in values:
        return values["height"]
    raise BadFileError("has no altitude")


def _require_degrees(columns: NamedColumns) -> None:
    latitude = columns.values["lat"]
    longitude = columns.values["lon"]
    # RocketPy names the unit of latitudes, or none: degrees either way.
    for row in np.flatnonzero(
        (np.abs(latitude) > 0.5 * np.pi) | (np.abs(longitude) > 2.0 * np.pi)
    ).tolist():
        raise BadFileError(
            f"line {columns.line_of(row)}: latitude and longitude are no place on the Earth"
        )


def _burns(text: str, columns: NamedColumns) -> FloatArray | None:
    """Return the burns (k, 2) by events, else by thrust; None where a file has neither."""
    spans = _of_events(text)
    time_s = columns.values["time"]
    if not spans and "thrust" in columns.values:
        thrust = np.nan_to_num(columns.values["thrust"])
        is_lit = thrust > _LIT * max(float(thrust.max()), 1e-9)
        edge = np.diff(np.concatenate([[0], is_lit.astype(np.int8), [0]]))
        ends = np.minimum(np.flatnonzero(edge < 0), len(time_s) - 1)
        spans = list(
            zip(time_s[np.flatnonzero(edge > 0)].tolist(), time_s[ends].tolist(), strict=True)
        )
    clipped = [(max(start, float(time_s[0])), min(end, float(time_s[-1]))) for start, end in spans]
    found = [span for span in clipped if span[1] > span[0]]
    return np.array(_joined(found)[:MOST_BURNS]) if found else None


def _of_events(text: str) -> list[tuple[float, float]]:
    """Return burns from the events IGNITION (or LAUNCH) and BURNOUT, in order of time."""
    events = [
        (float(time.replace(",", ".")), name)
        for name, time in _EVENT.findall(text)
        if _is_number(time)
    ]
    spans = []
    lit = list[float]()
    for time, name in sorted(events, key=lambda event: event[0]):
        if name == "IGNITION" or (name == "LAUNCH" and not lit):
            lit.append(time)
        elif name == "BURNOUT" and lit:
            spans.append((lit.pop(0), time))
    return spans


def _is_number(text: str) -> bool:
    try:
        return bool(np.isfinite(float(text.replace(",", "."))))
    except ValueError:
        return False


def _joined(spans: Sequence[tuple[float, float]]) -> list[tuple[float, float]]:
    """Return spans that do not touch."""
    burns: list[tuple[float, float]] = []
    for span in sorted(spans):
        if burns and span[0] <= burns[-1][1] + 1e-6:
            burns[-1] = burns[-1][0], max(span[1], burns[-1][1])
        else:
            burns.append(span)
    return burns
