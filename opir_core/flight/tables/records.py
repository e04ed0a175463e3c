"""What a table of states comes to, whatever its file looks like, and what is wrong with one that cannot be read."""

import numpy as np
from attrs import frozen
from numpy.typing import NDArray

from opir_core.arrays import FloatArray

#: A position nearer to the Earth's centre than this, m, is not in metres, or not of this Earth.
LEAST_RADIUS_M = 6.2e6


#: One farther from it, m, is beyond the Moon.
MOST_RADIUS_M = 1e9


class BadTableError(ValueError):
    """A table that cannot be taken; its one argument says why, with the line and the way out."""


@frozen(eq=False)
class Table:
    """States in order of time: scene times (n,), s, ECEF positions (n, 3), m, and velocities over the Earth, m/s.

    `velocity_m_s` is None where the file has none. `run` (n,) numbers the stretches within which the motion is smooth:
    where one ends and the next begins, so do the polynomials. `burn_s` is when it burns, as far as the file says.
    """

    time_s: FloatArray
    position_m: FloatArray
    velocity_m_s: FloatArray | None
    run: NDArray[np.intp]
    burn_s: tuple[float, float]


def require_order(time_s: FloatArray, lines: list[int], *, may_repeat: bool) -> None:
    """Raise `BadTableError` where times do not increase; a time may stand twice in a row where `may_repeat`."""
    step = np.diff(time_s)
    wrong = np.flatnonzero(step < 0.0 if may_repeat else step <= 0.0)
    thrice = np.flatnonzero((step[1:] == 0.0) & (step[:-1] == 0.0)) + 1 if may_repeat else wrong[:0]
    for row in [*wrong.tolist(), *thrice.tolist()]:
        raise BadTableError(
            f"line {lines[row + 1]}: its time does not follow that of line {lines[row]}; sort the states"
        )


def require_places(position_m: FloatArray, lines: list[int]) -> None:
    """Raise `BadTableError` for a position deep inside the Earth or beyond the Moon: most likely in other units."""
    with np.errstate(over="ignore"):
        radius_m = np.sqrt((position_m * position_m).sum(axis=1))
    for row in np.flatnonzero((radius_m < LEAST_RADIUS_M) | (radius_m > MOST_RADIUS_M)).tolist():
        where = "deep below the ground" if radius_m[row] < LEAST_RADIUS_M else "beyond the Moon"
        place = f"{radius_m[row]:.6g} m from the Earth's centre, {where}"
        raise BadTableError(f"line {lines[row]}: the position is {place}; check its units")
