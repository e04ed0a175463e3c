"""A map of a flight in a few lines of text."""

import numpy as np

from opir_core.arrays import FloatArray
from opir_core.geometry import ecef_to_geodetic

_COLUMNS = 60
_ROWS = 12

#: The least extent of a map, deg, and the most states that are drawn.
_LEAST_DEG = 0.02
_MOST = 20_000


def map_lines(position_m: FloatArray) -> list[str]:
    """Return a map of ECEF positions (n, 3), north up: the first is o, the last x. It is as wide as
    the ground.

    Longitudes count on across the 180th meridian.
    """
    stride = -(-len(position_m) // _MOST)
    rows = np.append(np.arange(0, len(position_m), stride), len(position_m) - 1)
    where = ecef_to_geodetic(position_m[rows])
    latitude = np.degrees(where.latitude_rad)
    longitude = np.degrees(np.unwrap(where.longitude_rad))
    south, north = _extent(latitude, _LEAST_DEG)
    level = max(np.cos(np.radians(0.5 * (south + north))), 0.05)
    # A character is twice as high as wide: 60 by 12 of them are 60 by 24.
    height = max(
        north - south, (longitude.max() - longitude.min()) * level * 2.0 * _ROWS / _COLUMNS
    )
    width = height / level * _COLUMNS / (2.0 * _ROWS)
    south, north = _around(south, north, height)
    west, east = _around(float(longitude.min()), float(longitude.max()), width)
    marks = [[" "] * _COLUMNS for _ in range(_ROWS)]
    column = np.clip(
        np.round((longitude - west) / (east - west) * (_COLUMNS - 1)), 0, _COLUMNS - 1
    ).astype(int)
    line = np.clip(
        np.round((north - latitude) / (north - south) * (_ROWS - 1)), 0, _ROWS - 1
    ).astype(int)
    for x, y in zip(column.tolist(), line.tolist(), strict=True):
        marks[y][x] = "."
    marks[line[-1]][column[-1]] = "x"
    marks[line[0]][column[0]] = "o"
    names = (
        f"{_name(west, 'E', 'W')} to {_name(east, 'E', 'W')}, {_name(south, 'N', 'S')} to"
        f" {_name(north, 'N', 'S')}"
    )
    frame = f"+{'-' * _COLUMNS}+"
    return [
        frame,
        *(f"|{''.join(row)}|" for row in marks),
        frame,
        f"{names}; o first, x last state",
    ]


def _extent(values: FloatArray, least: float) -> tuple[float, float]:
    return _around(
        float(values.min()), float(values.max()), max(float(values.max() - values.min()), least)
    )


def _around(low: float, high: float, size: float) -> tuple[float, float]:
    middle = 0.5 * (low + high)
    return middle - 0.5 * size, middle + 0.5 * size


def _name(angle_deg: float, positive: str, negative: str) -> str:
    turned = (angle_deg + 180.0) % 360.0 - 180.0 if positive == "E" else angle_deg
    return f"{abs(turned):.2f}° {positive if turned >= 0.0 else negative}"
