"""Lambert's problem: the two-body arc from one point to another in a given time, less than one turn."""

from math import isfinite
from typing import Literal, get_args

import numpy as np
from numpy.typing import ArrayLike

from opir_core.arrays import FloatArray
from opir_core.constants import EARTH_MU_M3_S2
from opir_core.flight.column_vectors import cross, dot, length
from opir_core.flight.kepler import flat_states
from opir_core.flight.lambert_time import Transfer, solved_w, y_and_differences

Way = Literal["short", "long", "prograde", "retrograde"]


def lambert(
    position_1_m: ArrayLike,
    position_2_m: ArrayLike,
    duration_s: ArrayLike,
    mu_m3_s2: float = EARTH_MU_M3_S2,
    way: Way = "short",
) -> tuple[FloatArray, FloatArray]:
    """Return the velocities, m/s, at both ends of the arc from one position to the other in `duration_s`.

    Positions have shape (..., 3), in an inertial frame centred on the attracting body; leading axes broadcast with the
    shape of `duration_s`. `way` is "short" (by less than half a turn), "long" (by more), or round the z axis,
    "prograde" (counter-clockwise seen from +z) or "retrograde"; in a plane that holds the z axis, prograde is the short
    way. Two points on one ray from the centre are joined by the straight line, up and down again where the time is
    long enough; so is a point with itself.

    `nan` where there is no such arc or no one arc: opposite points, and the long way between points on one ray, leave
    the plane open; times not above zero; a point in the centre; inputs that are not finite.

    Source: Izzo, Revisiting Lambert's problem, Celestial Mechanics and Dynamical Astronomy 121 (2015) 1-15, rearranged
    against cancellation (`lambert_time`).
    """
    if way not in get_args(Way):
        raise ValueError(f"way must be one of {', '.join(get_args(Way))}, got {way!r}")
    if not (isfinite(mu_m3_s2) and mu_m3_s2 > 0.0):
        raise ValueError(f"mu_m3_s2 must be positive and finite, got {mu_m3_s2}")
    first, second, duration, shape = flat_states(position_1_m, position_2_m, duration_s)
    with np.errstate(all="ignore"):
        velocities = _velocities(first.T.copy(), second.T.copy(), duration, mu_m3_s2, way)
    v1, v2 = (np.where(np.isfinite(velocities).all(axis=(0, 1)), v, np.nan) for v in velocities)
    return v1.T.reshape(*shape, 3), v2.T.reshape(*shape, 3)


def _velocities(
    first: FloatArray, second: FloatArray, duration: FloatArray, mu: float, way: Way
) -> tuple[FloatArray, FloatArray]:
    """Return velocities at both ends, (3, n), of arcs between positions (3, n)."""
    r1, r2 = length(first), length(second)
    across, along = second - first, second + first
    chord = length(across)
    semi = 0.5 * (r1 + r2 + chord)
    direction_1, direction_2 = first / r1, second / r2
    half_cosine, half_sine = 0.5 * length(direction_1 + direction_2), 0.5 * length(direction_1 - direction_2)
    normal, sense = _normal_and_sense(first, across, along, way)
    mean = np.sqrt(r1) * np.sqrt(r2)
    transfer = Transfer(sense * mean * half_cosine / semi, chord / semi)
    w = solved_w(transfer, duration * np.sqrt(2.0 * mu / semi) / semi)
    inward = np.where(chord > 0.0, -dot(across, along) / ((r1 + r2) * chord), 0.0)
    sideways = np.where(chord > 0.0, 2.0 * mean * half_sine / chord, 0.0)
    less, plus, y_plus_lam_x = _combinations(transfer, w)
    scale = np.sqrt(0.5 * mu * semi)
    radial_1, radial_2 = (less - inward * plus) / r1, -(less + inward * plus) / r2
    tangential = sideways * y_plus_lam_x
    return (
        scale * (radial_1 * direction_1 + tangential / r1 * cross(normal, direction_1)),
        scale * (radial_2 * direction_2 + tangential / r2 * cross(normal, direction_2)),
    )


def _combinations(transfer: Transfer, w: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Return lam y - x, lam y + x and y + lam x, none of them cancelling."""
    lam, chord = transfer
    x = w - 1.0
    y, _, _, _, y_plus_lam_x = y_and_differences(transfer, w)
    product = chord * (lam * lam - x * x * (1.0 + lam * lam))
    same = lam * x > 0.0
    less = np.where(same, product / (lam * y + x), lam * y - x)
    plus = np.where(same, lam * y + x, product / (lam * y - x))
    return less, plus, y_plus_lam_x


def _normal_and_sense(
    first: FloatArray, across: FloatArray, along: FloatArray, way: Way
) -> tuple[FloatArray, FloatArray]:
    """Return the unit vector about which the arc turns, and 1 for the short way, -1 for the long.

    Points on one ray have no normal, and need none the short way: it is zero there. Where a normal is missed it is nan.
    """
    nearer = np.where(dot(across, across) < dot(along, along), across, along)
    normal = cross(first, nearer)
    size = length(normal)
    upward = normal[2] >= 0.0
    short = {"short": np.True_, "long": np.False_, "prograde": upward, "retrograde": ~upward}[way]
    sense = np.where(short, 1.0, -1.0) * np.ones_like(size)
    on_one_ray = (size == 0.0) & (dot(across, across) < dot(along, along)) & (sense > 0.0)
    return np.where(on_one_ray, 0.0, sense * normal / size), sense
