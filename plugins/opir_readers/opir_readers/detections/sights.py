"""Tables of lines of sight as text: a line of column names with units, then one detection per line.

Columns: the time, as a date or as seconds of the scene; the sensor's id; the direction, as azimuth
and elevation at the sensor, azimuth from the south or zenith angle, as right ascension and
declination of J2000 or of date, or as a vector in ECEF or EME2000; perhaps the sensor's place, the standard deviation,
SNR, confidence, type, and the target that it was of, which scores alone read.
"""

import itertools
import math
import re
from collections.abc import Iterator, Mapping, Sequence
from typing import Any, NamedTuple

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
    Units,
    columns_by_quantity,
    map_complaint,
    plain_name,
    quantity_of,
    unit_of,
    unix_s_of_scale,
    unread_note,
    xyz,
)
from opir_readers.csv_layout import Layout, layout_of, table_layout
from opir_readers.detections.numbers import NOTES, Row, Rows
from opir_readers.detections.times import date_text
from opir_readers.odd_dates import date_notes
from opir_readers.published import published

_UNITS = published("units")
#: Directions in degrees, as events have them: a factor of 1 moves no digit.
_DEGREES: Units = _UNITS["angle in degrees"]
_PLAIN: Units = {"": 1.0}
_VECTOR = xyz("los_{}_ecef")
_INERTIAL = xyz("los_{}_eme2000")
_PLACE = xyz("sensor_{}_ecef")
_GEODETIC = ("sensor_lat", "sensor_lon", "sensor_height")

#: Columns of text, which have no units.
TEXTS = ("timestamp", "reported_at", "sensor_id", "target_id", "target_type", "detection_id")

#: The units of each quantity, the first of them where none is named. Standard deviations in
#: microradians.
UNITS: Mapping[str, Units] = {
    "time": TIMES,
    **SCALE_UNITS,
    **dict.fromkeys(
        ("azimuth", "azimuth_from_south", "elevation", "zenith_angle", "declination"), _DEGREES
    ),
    "right_ascension": _UNITS["right ascension in degrees"],
    "right_ascension_of_date": _UNITS["right ascension in degrees"],
    "declination_of_date": _DEGREES,
    **dict.fromkeys((*_VECTOR, *_INERTIAL), _PLAIN),
    **dict.fromkeys(_PLACE, LENGTHS),
    "sensor_lat": ANGLES,
    "sensor_lon": ANGLES,
    "sensor_height": LENGTHS,
    "line_of_sight_sigma": _UNITS["angle in microradians"],
    **dict.fromkeys(("snr", "confidence", *TEXTS), _PLAIN),
}

#: How a line may give its direction.
_DIRECTIONS = (
    *itertools.product(("azimuth", "azimuth_from_south"), ("elevation", "zenith_angle")),
    ("right_ascension", "declination"),
    ("right_ascension_of_date", "declination_of_date"),
    _VECTOR,
    _INERTIAL,
)

#: Figures of a row by name: the quantity of their column.
_FIGURES = {
    "line_of_sight_sigma_urad": "line_of_sight_sigma",
    "snr": "snr",
    "confidence": "confidence",
}

#: Angles in hours or degrees, minutes and seconds.
_SEXAGESIMAL = re.compile(r"([+-]?)(\d+)[: ](\d\d?)[: ](\d\d?(?:\.\d*)?)")


class _Line(NamedTuple):
    """The numbers of a line by quantity, None for an empty cell, and the line's number."""

    columns: Mapping[str, Column]
    values: Mapping[str, float | None]
    line: int

    def needed(self, *names: str) -> list[float]:
        """Return numbers that must not be empty."""
        numbers = []
        for name in names:
            value = self.values.get(name)
            if value is None:
                column = self.columns[name].name if name in self.columns else name
                raise BadFileError(f"line {self.line}: {column} is empty")
            numbers.append(value)
        return numbers


def is_of_sights(text: str) -> bool:
    """Whether the names of a table's columns have a direction from a sensor, and no place of a
    flight.
    """
    if text.lstrip()[:1] in ("{", "[", "<"):
        return False
    try:
        names = layout_of(text).names
    except BadFileError:
        return False
    sights = {known[0] for name in names if (known := _quantity_of(name))}
    places = {known[0] for name in names if (known := quantity_of(name))}
    is_flight = any(set(group) <= places for group in PLACES)
    return not is_flight and any(set(group) <= sights for group in _DIRECTIONS)


def sights_complaint(columns: Mapping[str, str] | None) -> str | None:
    """Return the first error in the quantities of a column map, or None."""
    return map_complaint(columns, UNITS, _quantity_of)


def sight_rows(text: str, start_s: float, columns: Mapping[str, str]) -> Rows:
    """Return the detections of a text whose time 0 is the scene time `start_s`; raises
    `BadFileError`.

    `columns` maps quantities with units to names of columns; others are known by their own names.
    """
    text, layout = table_layout(text, columns.values())
    known = _columns(layout, columns)
    notes = [*unread_note(layout.names, known), *_date_notes(known, text, layout)]
    rows = [_row(known, layout, cells, line, start_s) for line, cells in layout.rows(text)]
    if not rows:
        raise BadFileError("has no detection below the names of its columns")
    return [{**rows[0], NOTES: notes}, *rows[1:]]


def _date_notes(columns: Mapping[str, Column], text: str, layout: Layout) -> Iterator[str]:
    """Yield what the times of a scale may be instead, by the first line."""
    scale = next((name for name in SCALES if name in columns), "")
    if scale and columns.keys().isdisjoint(("time", "timestamp")):
        for line, cells in itertools.islice(layout.rows(text), 1):
            since_s = _value(columns[scale], cells[columns[scale].place], layout, line)
            yield from date_notes(scale, since_s or 0.0, line)


def _quantity_of(name: str) -> tuple[str, float] | None:
    """Return the quantity that a column's name stands for and its unit, or None."""
    plain = plain_name(name)
    return unit_of(published("sight_names").get(plain, plain), UNITS)


def _columns(layout: Layout, columns: Mapping[str, str]) -> Mapping[str, Column]:
    """Return the columns that are read, by quantity; raises `BadFileError` where they make no
    detections.

    Of `time` beside `time_s` only the second is read: the first may be a date.
    """
    names = layout.names
    skipped = [
        name
        for name in UNITS
        if name in names and name not in columns.values() and _has_unit_beside(name, names)
    ]
    known = columns_by_quantity(names, layout.line, columns, _quantity_of, skipped=skipped)
    _require_detections(known, layout)
    return known


def _has_unit_beside(name: str, names: Sequence[str]) -> bool:
    """Whether the same quantity stands beside a column of its name with a unit, as `time_s`."""
    return any(
        column.startswith(f"{name}_") and (_quantity_of(column) or ("",))[0] == name
        for column in names
    )


def _require_detections(columns: Mapping[str, Column], layout: Layout) -> None:
    lacking = [] if {"time", "timestamp", *SCALES} & columns.keys() else ["time_s (or timestamp)"]
    if not any(set(group) <= columns.keys() for group in _DIRECTIONS):
        lacking.append(
            "a direction (azimuth_deg and elevation_deg, or right_ascension_deg and"
            " declination_deg, or los_x_ecef, los_y_ecef and los_z_ecef)"
        )
    for group in (_PLACE, _GEODETIC):
        if not columns.keys().isdisjoint(group):
            lacking += [name for name in group if name not in columns]
    if lacking:
        names = ", ".join(map(repr, layout.names[:12]))
        raise BadFileError(
            f"line {layout.line}: lacks {', '.join(lacking)}; it has {names}; say what they are"
            " with columns"
        )


def _row(
    columns: Mapping[str, Column], layout: Layout, cells: list[str], number: int, start_s: float
) -> Row:
    layout.require_width(cells, number)
    row: dict[str, Any] = {"line": number}
    for name in TEXTS:
        if name in columns and (text := cells[columns[name].place].strip()):
            row[name] = text
    values = {
        name: _value(column, cells[column.place], layout, number)
        for name, column in columns.items()
        if name not in TEXTS
    }
    line = _Line(columns, values, number)
    if "timestamp" not in row:
        row |= _time(line, start_s)
    row |= _direction(line)
    if _PLACE[0] in columns:
        row["sensor_position_ecef_m"] = line.needed(*_PLACE)
    elif _GEODETIC[0] in columns:
        row["sensor_position_ecef_m"] = geodetic_to_ecef(*line.needed(*_GEODETIC)).tolist()
    for figure, name in _FIGURES.items():
        if (value := values.get(name)) is not None:
            row[figure] = value
    return row


def _time(line: _Line, start_s: float) -> Row:
    """Return the time of a line: a date of a scale, else seconds of the scene."""
    scale = next((name for name in SCALES if name in line.columns), "")
    if scale and "time" not in line.columns:
        (since_s,) = line.needed(scale)
        return {"timestamp": date_text(round(unix_s_of_scale(scale, since_s) * 1e9))}
    return {"time_s": line.needed("time")[0] + start_s}


def _direction(line: _Line) -> Row:
    group = next(names for names in _DIRECTIONS if set(names) <= line.columns.keys())
    numbers = line.needed(*group)
    if group is _VECTOR:
        return {"line_of_sight_ecef": numbers}
    if group is _INERTIAL:
        return {"line_of_sight_eme2000": numbers}
    if group[0].startswith("right_ascension"):
        angles = dict(zip(("right_ascension_deg", "declination_deg"), numbers, strict=True))
        return {**angles, "reference_frame": "TOD"} if group[0].endswith("date") else angles
    return {
        "azimuth_deg": numbers[0] + (180.0 if group[0] == "azimuth_from_south" else 0.0),
        "elevation_deg": 90.0 - numbers[1] if group[1] == "zenith_angle" else numbers[1],
    }


def _value(column: Column, cell: str, layout: Layout, line: int) -> float | None:
    """Return the number of a cell in the unit of rows, None for an empty one."""
    bare = cell.strip()
    if not bare:
        return None
    is_celestial = column.quantity.startswith(("right_ascension", "declination"))
    sexagesimal = _SEXAGESIMAL.fullmatch(bare) if is_celestial else None
    try:
        value = _decimal(*sexagesimal.groups()) if sexagesimal else layout.number(bare)
    except ValueError:
        value = math.nan
    if not math.isfinite(value):
        raise BadFileError(f"line {line}: {column.name} is {bare!r}, not a finite number")
    return value * column.factor


def _decimal(sign: str, degrees: str, minutes: str, seconds: str) -> float:
    """Return the number of an angle in hours or degrees, minutes and seconds.

    >>> _decimal("-", "1", "30", "0")
    -1.5
    """
    size = float(degrees) + float(minutes) / 60.0 + float(seconds) / 3600.0
    return -1.0 * size if sign == "-" else size
