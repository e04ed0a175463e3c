"""The checks that states of every format pass."""

import math
from collections.abc import Callable
from typing import Any

import numpy as np

from opir_core.arrays import FloatArray
from opir_core.geometry import dot
from opir_core.plugin import BadFileError, StateTable

#: Positions nearer to the Earth's centre, or farther from it, m, are most likely in other units.
LEAST_RADIUS_M = 6.2e6
MOST_RADIUS_M = 1e9

#: The most burns of a flight, as many as plumes have stages.
MOST_BURNS = 8

#: The frame of states that speeds and altitudes along an azimuth were made into.
TELEMETRY = (
    "speed and altitude from a launch point, along an azimuth that the Earth's rotation turns"
)

#: Returns the line of a file that a row stands in.
LineOf = Callable[[int], int]


def number_or_nan(value: Any) -> float:
    """Return a finite number, nan for text and numbers that are not."""
    try:
        number = float(value)
    except (TypeError, ValueError, OverflowError):
        return math.nan
    return number if math.isfinite(number) else math.nan


def single_run(
    time_s: FloatArray,
    position_m: FloatArray,
    velocity_m_s: FloatArray | None,
    line_of: LineOf,
    **described: Any,
) -> StateTable:
    """Return the table of states (n, 3) in one smooth run that burns throughout.

    `described` are further fields of the table. Raises `BadFileError` for states out of order or
    out of bounds.
    """
    require_order(time_s, line_of, may_repeat=False)
    require_places(position_m, line_of)
    require_velocities(velocity_m_s, line_of)
    run = np.zeros(len(time_s), dtype=np.int64)
    return StateTable(
        time_s, position_m, velocity_m_s, run, time_s[None, [0, -1]], line_of, **described
    )


def require_order(time_s: FloatArray, line_of: LineOf, *, may_repeat: bool) -> None:
    """Raise `BadFileError` where times do not increase; with `may_repeat` a time may occur twice in
    a row.

    `line_of` gives the line of a row. States nearer in time than 1e-7 s are refused too.
    """
    step = np.diff(time_s)
    rows = np.flatnonzero(step < 0.0 if may_repeat else step <= 0.0).tolist()
    if may_repeat:
        rows += (np.flatnonzero((step[1:] == 0.0) & (step[:-1] == 0.0)) + 1).tolist()
    for row in rows:
        raise BadFileError(
            f"line {line_of(row + 1)}: its time does not follow that of line {line_of(row)}; sort"
            " the states"
        )
    for row in np.flatnonzero((step > 0.0) & (step < 1e-7)).tolist():
        raise BadFileError(
            f"line {line_of(row + 1)}: is {step[row]:g} s after line {line_of(row)}; leave one out"
        )


def require_places(position_m: FloatArray, line_of: LineOf) -> None:
    """Raise `BadFileError` for a position deep inside the Earth or beyond the Moon; `line_of` gives
    a row's line. Such positions are most likely in other units.
    """
    with np.errstate(over="ignore"):
        radius_m = np.sqrt(dot(position_m, position_m))
    for row in np.flatnonzero((radius_m < LEAST_RADIUS_M) | (radius_m > MOST_RADIUS_M)).tolist():
        where = "deep below the ground" if radius_m[row] < LEAST_RADIUS_M else "beyond the Moon"
        place = f"{radius_m[row]:.6g} m from the Earth's centre, {where}"
        raise BadFileError(f"line {line_of(row)}: the position is {place}; check its units")


def require_angles(latitude_rad: FloatArray, longitude_rad: FloatArray, line_of: LineOf) -> None:
    """Raise `BadFileError` for a latitude beyond 90°, or a longitude beyond 360°."""
    for row in rows_off_the_earth(latitude_rad, longitude_rad):
        latitude, longitude = np.degrees([latitude_rad[row], longitude_rad[row]]).tolist()
        raise BadFileError(
            f"line {line_of(row)}: latitude {latitude:g} and longitude {longitude:g} deg are no"
            " place; set columns if the two are exchanged (lat_deg: NAME, lon_deg: NAME) or in"
            " other units (lat_rad: NAME)"
        )


def rows_off_the_earth(latitude_rad: FloatArray, longitude_rad: FloatArray) -> list[int]:
    """Return the rows whose latitude is beyond 90°, or longitude beyond 360°."""
    is_off = (np.abs(latitude_rad) > 0.5 * np.pi) | (np.abs(longitude_rad) > 2.0 * np.pi)
    return np.flatnonzero(is_off).tolist()


def require_velocities(velocity_m_s: FloatArray | None, line_of: LineOf) -> None:
    """Raise `BadFileError` for a velocity above that of light."""
    if velocity_m_s is None:
        return
    for row in np.flatnonzero((np.abs(velocity_m_s) > 3e8).any(axis=1)).tolist():
        fastest = float(np.abs(velocity_m_s[row]).max())
        raise BadFileError(
            f"line {line_of(row)}: a velocity of {fastest:.3g} m/s is above that of light"
        )
