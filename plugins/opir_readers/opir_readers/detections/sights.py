"""Tables of lines of sight as text: a line of column names with units, then one detection per line.

Columns: the time, as a date or as seconds of the scene; the sensor's id; the direction, as azimuth
and elevation at the sensor, azimuth from the south or zenith angle, as right ascension and
declination, or as a vector in ECEF or EME2000; perhaps the sensor's place, the standard deviation,
SNR, confidence, type, and the target that it was of, which scores alone read.
"""

import itertools
import math
import re
from collections.abc import Mapping, Sequence
from difflib import get_close_matches
from typing import Any

from opir_core.geometry import geodetic_to_ecef
from opir_core.plugin import BadFileError
from opir_readers.columns import (
    ANGLES,
    LENGTHS,
    PLACES,
    SCALE_UNITS,
    SCALES,
    TIMES,
    Column,
    plain_name,
    quantity_of,
    unit_of,
    unix_s_of_scale,
)
from opir_readers.csv_layout import Layout, decimal, layout_of, with_dates_named
from opir_readers.detections.times import date_text
from opir_readers.json_text import table_of_json

Row = Mapping[str, Any]

#: Directions in degrees, as events have them: a factor of 1 moves no digit. Standard deviations in
#: microradians.
_DEGREES = {"deg": 1.0, "rad": 180.0 / math.pi}
_HOURS = _DEGREES | {"h": 15.0}
_MICRORADIANS = {
    "urad": 1.0,
    "mrad": 1e3,
    "rad": 1e6,
    "deg": 1e6 * math.pi / 180.0,
    "arcsec": 1e6 * math.pi / 648000.0,
}
_PLAIN = {"": 1.0}
_VECTOR = ("los_x_ecef", "los_y_ecef", "los_z_ecef")
_INERTIAL = ("los_x_eme2000", "los_y_eme2000", "los_z_eme2000")
_PLACE = ("sensor_x_ecef", "sensor_y_ecef", "sensor_z_ecef")
_GEODETIC = ("sensor_lat", "sensor_lon", "sensor_height")

#: Columns of text, which have no units.
TEXTS = ("timestamp", "reported_at", "sensor_id", "target_id", "target_type", "detection_id")

#: The units of each quantity, the first of them where none is named.
UNITS: Mapping[str, Mapping[str, float]] = {
    "time": TIMES,
    **SCALE_UNITS,
    **dict.fromkeys(
        ("azimuth", "azimuth_from_south", "elevation", "zenith_angle", "declination"), _DEGREES
    ),
    "right_ascension": _HOURS,
    **dict.fromkeys((*_VECTOR, *_INERTIAL), _PLAIN),
    **dict.fromkeys(_PLACE, LENGTHS),
    "sensor_lat": ANGLES,
    "sensor_lon": ANGLES,
    "sensor_height": LENGTHS,
    "line_of_sight_sigma": _MICRORADIANS,
    "snr": _PLAIN,
    "confidence": _PLAIN,
    **dict.fromkeys(TEXTS, _PLAIN),
}

#: How a line may give its direction, and where each goes in a row.
_DIRECTIONS = (
    *itertools.product(("azimuth", "azimuth_from_south"), ("elevation", "zenith_angle")),
    ("right_ascension", "declination"),
    _VECTOR,
    _INERTIAL,
)

#: Angles in hours or degrees, minutes and seconds.
_SEXAGESIMAL = re.compile(r"([+-]?)(\d+)[: ](\d\d?)[: ](\d\d?(?:\.\d*)?)")

#: Other names of the same columns, in lower case.
_SYNONYMS = {
    "time_utc": "timestamp",
    "utc": "timestamp",
    "date": "timestamp",
    "sensor": "sensor_id",
    "az": "azimuth_deg",
    "el": "elevation_deg",
    "az_deg": "azimuth_deg",
    "el_deg": "elevation_deg",
    "ra_deg": "right_ascension_deg",
    "ra_h": "right_ascension_h",
    "ra_hours": "right_ascension_h",
    "dec_deg": "declination_deg",
    "sigma_urad": "line_of_sight_sigma_urad",
    "target": "target_id",
    "reported": "reported_at",
    **{f"sensor_{axis}_m": f"sensor_{axis}_ecef_m" for axis in "xyz"},
}


def is_of_sights(text: str) -> bool:
    """Return whether the names of a table's columns have a direction from a sensor, and no place of
    a flight.
    """
    if text.lstrip()[:1] in ("{", "[", "<"):
        return False
    try:
        names = layout_of(text).names
    except BadFileError:
        return False
    found = {quantity for name in names if (quantity := _quantity(name)[0])}
    places = {known[0] for name in names if (known := quantity_of(name))}
    is_flight = any(set(group) <= places for group in PLACES)
    return not is_flight and any(set(group) <= found for group in _DIRECTIONS)


def sights_complaint(columns: Mapping[str, str] | None) -> str | None:
    """Return the first error in the quantities of a column map, or None."""
    for name in columns or ():
        if not _quantity(name)[0]:
            near = get_close_matches(
                name, [f"{q}_{u}" if u else q for q, units in UNITS.items() for u in units], n=1
            )
            hint = f"did you mean {near[0]}?" if near else f"quantities are {', '.join(UNITS)}"
            return f"{name} is no quantity with its unit; {hint}"
    return None


def sight_rows(text: str, start_s: float, columns: Mapping[str, str]) -> Sequence[Row]:
    """Return the detections of a text whose time 0 is the scene time `start_s`; raises
    `BadFileError`.

    `columns` maps quantities with units to names of columns; others are known by their own names.
    """
    text = table_of_json(text) or text
    layout = with_dates_named(layout_of(text, columns.values()), text, columns.values())
    known = _columns(layout, columns)
    rows = [_row(known, layout, cells, line, start_s) for line, cells in layout.rows(text)]
    if not rows:
        raise BadFileError("has no detection below the names of its columns")
    return rows


def _quantity(name: str) -> tuple[str, float]:
    """Return the quantity that a column's name stands for and its unit; "" for none."""
    plain = plain_name(name)
    return unit_of(_SYNONYMS.get(plain, plain), UNITS) or ("", 1.0)


def _columns(layout: Layout, given: Mapping[str, str]) -> dict[str, Column]:
    """Return the columns that are read, by quantity; raises `BadFileError` where they make no
    detections.
    """
    mapped = {own: wanted for wanted, own in given.items()}
    for own in mapped:
        if own not in layout.names:
            listed = ", ".join(map(repr, layout.names))
            raise BadFileError(
                f"line {layout.line}: there is no column {own!r}, which columns names; there are"
                f" {listed}"
            )
    found: dict[str, Column] = {}
    for place, name in enumerate(layout.names):
        quantity, factor = _quantity(mapped.get(name, name))
        if (
            name not in mapped
            and quantity == name
            and any(_is_same_with_unit(other, name) for other in layout.names)
        ):
            continue
        if quantity in found and (name in mapped) == (found[quantity].name in mapped):
            raise BadFileError(
                f"line {layout.line}: names a column twice: {found[quantity].name!r} and {name!r}"
            )
        if quantity and (quantity not in found or name in mapped):
            found[quantity] = Column(place, name, quantity, factor)
    _require_whole(found, layout)
    return found


def _is_same_with_unit(other: str, name: str) -> bool:
    """Return whether a column is that of a name with its unit, as `time_s` beside `time`, which may
    be a date.
    """
    return other != name and _quantity(other)[0] == name and other.startswith(f"{name}_")


def _require_whole(found: Mapping[str, Column], layout: Layout) -> None:
    lacking = [] if {"time", "timestamp", *SCALES} & found.keys() else ["time_s (or timestamp)"]
    if not any(set(group) <= found.keys() for group in _DIRECTIONS):
        ways = (
            "azimuth_deg and elevation_deg, or right_ascension_deg and declination_deg, or"
            " los_x_ecef, los_y_ecef and"
        )
        lacking.append(f"a direction ({ways} los_z_ecef)")
    for group in (_PLACE, _GEODETIC):
        lacking += (
            [name for name in group if name not in found]
            if any(name in found for name in group)
            else []
        )
    if lacking:
        names = ", ".join(map(repr, layout.names[:12]))
        raise BadFileError(
            f"line {layout.line}: lacks {', '.join(lacking)}; it has {names}; say what they are"
            f" with columns"
        )


def _row(
    known: Mapping[str, Column], layout: Layout, cells: list[str], line: int, start_s: float
) -> Row:
    if len(cells) < len(layout.names) or any(cell.strip() for cell in cells[len(layout.names) :]):
        raise BadFileError(
            f"line {line}: has {len(cells)} values; line {layout.line} names {len(layout.names)}"
            f" columns"
        )
    texts = {name: cells[known[name].place].strip() for name in TEXTS if name in known}
    row: dict[str, Any] = {"line": line, **{name: text for name, text in texts.items() if text}}
    values = {
        name: _value(column, cells[column.place], layout, line)
        for name, column in known.items()
        if name not in TEXTS
    }
    scale = next((name for name in SCALES if name in known), "")
    if "timestamp" not in row and "time" not in known and scale:
        row["timestamp"] = date_text(
            round(unix_s_of_scale(scale, _needed(values, scale, known, line)) * 1e9)
        )
    if "timestamp" not in row:
        row["time_s"] = _needed(values, "time", known, line) + start_s
    _add_direction(row, values, known, line)
    if _PLACE[0] in known:
        row["sensor_position_ecef_m"] = [_needed(values, name, known, line) for name in _PLACE]
    elif _GEODETIC[0] in known:
        place = geodetic_to_ecef(*(_needed(values, name, known, line) for name in _GEODETIC))
        row["sensor_position_ecef_m"] = place.tolist()
    _add_figures(row, values)
    return row


def _add_direction(
    row: dict[str, Any], values: Mapping[str, float | None], known: Mapping[str, Column], line: int
) -> None:
    group = next(names for names in _DIRECTIONS if set(names) <= known.keys())
    numbers = [_needed(values, name, known, line) for name in group]
    if group is _VECTOR:
        row["line_of_sight_ecef"] = numbers
    elif group is _INERTIAL:
        row["line_of_sight_eme2000"] = numbers
    elif group[0] == "right_ascension":
        row |= dict(zip(("right_ascension_deg", "declination_deg"), numbers, strict=True))
    else:
        row["azimuth_deg"] = numbers[0] + (180.0 if group[0] == "azimuth_from_south" else 0.0)
        row["elevation_deg"] = 90.0 - numbers[1] if group[1] == "zenith_angle" else numbers[1]


def _add_figures(row: dict[str, Any], values: Mapping[str, float | None]) -> None:
    if values.get("line_of_sight_sigma") is not None:
        row["line_of_sight_sigma_urad"] = values["line_of_sight_sigma"]
    row |= {name: values[name] for name in ("snr", "confidence") if values.get(name) is not None}


def _needed(
    values: Mapping[str, float | None], name: str, known: Mapping[str, Column], line: int
) -> float:
    value = values.get(name)
    if value is None:
        raise BadFileError(f"line {line}: {known[name].name if name in known else name} is empty")
    return value


def _value(column: Column, cell: str, layout: Layout, line: int) -> float | None:
    if not cell.strip():
        return None
    parts = (
        _SEXAGESIMAL.fullmatch(cell.strip())
        if column.quantity in ("right_ascension", "declination")
        else None
    )
    try:
        value = _of_parts(*parts.groups()) if parts else decimal(cell, layout)
    except ValueError:
        value = math.nan
    if not math.isfinite(value):
        raise BadFileError(f"line {line}: {column.name} is {cell.strip()!r}, not a finite number")
    return value * column.factor


def _of_parts(sign: str, whole: str, minutes: str, seconds: str) -> float:
    """Return the number of an angle in hours or degrees, minutes and seconds.

    >>> _of_parts("-", "1", "30", "0")
    -1.5
    """
    return (-1.0 if sign == "-" else 1.0) * (
        float(whole) + float(minutes) / 60.0 + float(seconds) / 3600.0
    )
