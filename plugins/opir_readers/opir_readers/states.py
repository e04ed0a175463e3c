"""The checks that states of every format pass."""

from collections.abc import Callable

import numpy as np

from opir_core.arrays import FloatArray
from opir_core.plugin import BadFileError

#: Positions nearer to the Earth's centre, or farther from it, m, are most likely in other units.
LEAST_RADIUS_M = 6.2e6
MOST_RADIUS_M = 1e9

#: Nothing is faster than light, m/s, and no two states are nearer in time than this, s.
_FASTEST_M_S = 3e8
_LEAST_STEP_S = 1e-7

#: The most burns of a flight, as many as plumes have stages.
MOST_BURNS = 8

#: Returns the line of a file that a row stands in.
LineOf = Callable[[int], int]


def require_order(time_s: FloatArray, line_of: LineOf, *, may_repeat: bool) -> None:
    """Raise `BadFileError` where times do not increase; with `may_repeat` a time may occur twice in
    a row.

    `line_of` gives the line of a row.
    """
    step = np.diff(time_s)
    wrong = np.flatnonzero(step < 0.0 if may_repeat else step <= 0.0)
    close = np.flatnonzero((step > 0.0) & (step < _LEAST_STEP_S)).tolist()
    thrice = np.flatnonzero((step[1:] == 0.0) & (step[:-1] == 0.0)) + 1 if may_repeat else wrong[:0]
    for row in [*wrong.tolist(), *thrice.tolist()]:
        raise BadFileError(
            f"line {line_of(row + 1)}: its time does not follow that of line {line_of(row)}; sort"
            f" the states"
        )
    for row in close:
        raise BadFileError(
            f"line {line_of(row + 1)}: is {step[row]:g} s after line {line_of(row)}; leave one out"
        )


def require_places(position_m: FloatArray, line_of: LineOf) -> None:
    """Raise `BadFileError` for a position deep inside the Earth or beyond the Moon; `line_of` gives
    a row's line.
    """
    with np.errstate(over="ignore"):
        radius_m = np.sqrt((position_m * position_m).sum(axis=1))
    for row in np.flatnonzero((radius_m < LEAST_RADIUS_M) | (radius_m > MOST_RADIUS_M)).tolist():
        where = "deep below the ground" if radius_m[row] < LEAST_RADIUS_M else "beyond the Moon"
        place = f"{radius_m[row]:.6g} m from the Earth's centre, {where}"
        raise BadFileError(f"line {line_of(row)}: the position is {place}; check its units")


def require_angles(latitude_rad: FloatArray, longitude_rad: FloatArray, line_of: LineOf) -> None:
    """Raise `BadFileError` for a latitude beyond 90°, or a longitude beyond 360°."""
    for row in np.flatnonzero(
        (np.abs(latitude_rad) > 0.5 * np.pi) | (np.abs(longitude_rad) > 2.0 * np.pi)
    ).tolist():
        places = np.degrees([latitude_rad[row], longitude_rad[row]]).tolist()
        raise BadFileError(
            f"line {line_of(row)}: latitude {places[0]:g} and longitude {places[1]:g} deg are no"
            " place; are the two swapped, or the units others?"
        )


def require_velocities(velocity_m_s: FloatArray | None, line_of: LineOf) -> None:
    """Raise `BadFileError` for a velocity above that of light."""
    if velocity_m_s is None:
        return
    for row in np.flatnonzero((np.abs(velocity_m_s) > _FASTEST_M_S).any(axis=1)).tolist():
        fastest = float(np.abs(velocity_m_s[row]).max())
        raise BadFileError(
            f"line {line_of(row)}: a velocity of {fastest:.3g} m/s is above that of light"
        )
