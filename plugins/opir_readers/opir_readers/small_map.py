"""A map of a flight in a few lines of text."""

from typing import NamedTuple

import numpy as np

from opir_core.arrays import FloatArray
from opir_core.geometry import ecef_to_geodetic

_COLUMNS = 60
_ROWS = 12

#: The height of a map over its width in one unit: a character is twice as high as wide.
_SHAPE = 2.0 * _ROWS / _COLUMNS


class _Extent(NamedTuple):
    """The ends of an axis, deg."""

    low: float
    high: float

    def places(self, values: FloatArray, count: int) -> list[int]:
        """Return the nearest of `count` even places (n,) from the low end on."""
        share = (values - self.low) / (self.high - self.low)
        return np.clip(np.round(share * (count - 1)), 0, count - 1).astype(int).tolist()


def map_lines(position_m: FloatArray) -> list[str]:
    """Return a map of ECEF positions (n, 3), north up: the first is o, the last x. It is as wide as
    the ground.

    Longitudes count on across the 180th meridian. At most 20 000 states are drawn.
    """
    stride = -(-len(position_m) // 20_000)
    rows = np.append(np.arange(0, len(position_m), stride), len(position_m) - 1)
    where = ecef_to_geodetic(position_m[rows])
    latitude = np.degrees(where.latitude_rad)
    longitude = np.degrees(np.unwrap(where.longitude_rad))
    north_south, west_east = _extents(latitude, longitude)
    marks = [[" "] * _COLUMNS for _ in range(_ROWS)]
    columns = west_east.places(longitude, _COLUMNS)
    lines = _Extent(north_south.high, north_south.low).places(latitude, _ROWS)
    for column, line in zip(columns, lines, strict=True):
        marks[line][column] = "."
    marks[lines[-1]][columns[-1]] = "x"
    marks[lines[0]][columns[0]] = "o"
    west, east = (_name((angle + 180.0) % 360.0 - 180.0, "EW") for angle in west_east)
    south, north = (_name(angle, "NS") for angle in north_south)
    frame = f"+{'-' * _COLUMNS}+"
    return [
        frame,
        *(f"|{''.join(line)}|" for line in marks),
        frame,
        f"{west} to {east}, {south} to {north}; o first, x last state",
    ]


def _extents(latitude: FloatArray, longitude: FloatArray) -> tuple[_Extent, _Extent]:
    """Return the extents of a map in latitude and longitude, of one scale on the ground; in
    latitude 0.02 deg or more.
    """
    south, north = _around(latitude, max(float(np.ptp(latitude)), 0.02))
    level = max(np.cos(np.radians(0.5 * (south + north))), 0.05)
    height = max(north - south, float(np.ptp(longitude)) * level * _SHAPE)
    return _around(np.array([south, north]), height), _around(longitude, height / level / _SHAPE)


def _around(values: FloatArray, size: float) -> _Extent:
    middle = 0.5 * (float(values.min()) + float(values.max()))
    return _Extent(middle - 0.5 * size, middle + 0.5 * size)


def _name(angle_deg: float, signs: str) -> str:
    return f"{abs(angle_deg):.2f}° {signs[0] if angle_deg >= 0.0 else signs[1]}"
