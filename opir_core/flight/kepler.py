"""Two-body propagation of position and velocity: every conic, forward and back, any number of turns.

Each state is scaled by its own distance and circular speed, solved for its universal anomaly (`universal_anomaly`) and
carried on by Lagrange's f and g (Danby, Fundamentals of Celestial Mechanics, 2nd ed. 1988, §6.9; Battin, An
Introduction to the Mathematics and Methods of Astrodynamics, revised ed. 1999, §4.5). Hyperbolas that come in from
afar, where Kepler's equation cancels, are told from their pericentre (`kepler_flyby`).
"""

from collections.abc import Callable
from enum import IntEnum
from math import isfinite

import numpy as np
from numpy.typing import ArrayLike, NDArray

from opir_core.arrays import BoolArray, FloatArray
from opir_core.constants import EARTH_MU_M3_S2
from opir_core.flight.kepler_equation import Arcs
from opir_core.flight.kepler_flyby import flybys
from opir_core.flight.kepler_start import Start, start_of
from opir_core.flight.universal_anomaly import solved_quickly, solved_surely

Solver = Callable[[Arcs[np.float64]], tuple[FloatArray, BoolArray]]

#: States a block: enough to hide numpy's overhead, few enough for the arrays of a block to stay in the cache.
_BLOCK = 16384


class KeplerStatus(IntEnum):
    """Whether a state could be propagated, and if not, why its result is `nan`."""

    OK = 0
    NOT_FINITE = 1  #: an input is nan or infinite
    AT_CENTRE = 2  #: the arc starts in the centre of attraction, where gravity has no direction
    OUT_OF_RANGE = 3  #: squares or products of the inputs leave the range of double precision
    PHASE_LOST = 4  #: so many turns that double precision holds no digit of the phase
    NOT_REACHED = 5  #: the end is in the centre, beyond the range of double precision, or was not found


def propagate_kepler(
    position_m: ArrayLike, velocity_m_s: ArrayLike, duration_s: ArrayLike, mu_m3_s2: float = EARTH_MU_M3_S2
) -> tuple[FloatArray, FloatArray]:
    """Return position, m, and velocity, m/s, after `duration_s` on the two-body arc through the given state.

    Position and velocity have shape (..., 3), in any inertial frame centred on the attracting body; leading axes
    broadcast with the shape of `duration_s`, which may be negative. `mu_m3_s2` is one positive number. Ellipses over
    any number of turns, parabolas, hyperbolas and straight lines alike; a straight line through the centre goes on as
    ever thinner ellipses do in the limit: back the way it came.

    The relative error of the position is below 1e-12, or below ten times what rounding each input to double precision
    does to it. Where there is no result it is `nan`, and `kepler_status` says why. An element has the same bits alone
    and in any batch.
    """
    return _propagated(position_m, velocity_m_s, duration_s, mu_m3_s2)[:2]


def kepler_status(
    position_m: ArrayLike, velocity_m_s: ArrayLike, duration_s: ArrayLike, mu_m3_s2: float = EARTH_MU_M3_S2
) -> NDArray[np.int8]:
    """Return the `KeplerStatus` of each state that `propagate_kepler` makes of the same arguments."""
    return _propagated(position_m, velocity_m_s, duration_s, mu_m3_s2)[2]


def _propagated(
    position_m: ArrayLike, velocity_m_s: ArrayLike, duration_s: ArrayLike, mu_m3_s2: float
) -> tuple[FloatArray, FloatArray, NDArray[np.int8]]:
    if not (isfinite(mu_m3_s2) and mu_m3_s2 > 0.0):
        raise ValueError(f"mu_m3_s2 must be positive and finite, got {mu_m3_s2}")
    position, velocity, duration, shape = flat_states(position_m, velocity_m_s, duration_s)
    with np.errstate(all="ignore"):
        end, status = _in_blocks(position, velocity, duration, float(mu_m3_s2))
    return end[0].reshape(*shape, 3), end[1].reshape(*shape, 3), status.reshape(shape)


def flat_states(
    first: ArrayLike, second: ArrayLike, scalar: ArrayLike
) -> tuple[FloatArray, FloatArray, FloatArray, tuple[int, ...]]:
    """Return two vectors (n, 3) and a number (n,) of each element, broadcast together, and their common shape."""
    one, two, number = (np.asarray(x, dtype=np.float64) for x in (first, second, scalar))
    for vectors in (one, two):
        if vectors.ndim == 0 or vectors.shape[-1] != 3:
            raise ValueError(f"expected vectors with a last axis of 3 (x, y, z), got shape {vectors.shape}")
    shape = np.broadcast_shapes(one.shape[:-1], two.shape[:-1], number.shape)
    one, two = (x if x.shape[:-1] == shape else np.broadcast_to(x, (*shape, 3)) for x in (one, two))
    return one.reshape(-1, 3), two.reshape(-1, 3), np.broadcast_to(number, shape).reshape(-1), shape


def _in_blocks(
    position: FloatArray, velocity: FloatArray, duration: FloatArray, mu: float
) -> tuple[FloatArray, NDArray[np.int8]]:
    """Return the end states (2, n, 3) and their status: a quick pass in blocks, then those it left, together."""
    end = np.empty((2, duration.size, 3))
    left = [np.empty(0, np.intp)]
    for first in range(0, duration.size, _BLOCK):
        block = slice(first, first + _BLOCK)
        start = start_of(position[block], velocity[block], duration[block], mu)
        unfinished = _follow(start, solved_quickly, end[:, block])
        if not np.isfinite(end[:, block].sum()):
            unfinished |= ~np.isfinite(end[:, block]).all(axis=(0, 2))
        left.append(first + np.flatnonzero(unfinished))
    status = np.zeros(duration.size, np.int8)
    at = np.concatenate(left)
    for first in range(0, at.size, _BLOCK):
        part = at[first : first + _BLOCK]
        end[:, part], status[part] = _with_care(position[part], velocity[part], duration[part], mu)
    return end, status


def _with_care(
    position: FloatArray, velocity: FloatArray, duration: FloatArray, mu: float
) -> tuple[FloatArray, NDArray[np.int8]]:
    """Return end states (2, n, 3) and status of those that the quick pass left."""
    start = start_of(position, velocity, duration, mu)
    at = np.flatnonzero(start.is_well())
    followed = np.empty((2, at.size, 3))
    _follow(start.at(at), solved_surely, followed)
    end = np.full((2, duration.size, 3), np.nan)
    end[:, at] = followed
    end[:, ~np.isfinite(end).all(axis=(0, 2))] = np.nan
    return end, _reasons(position, velocity, duration, start, end)


def _reasons(
    position: FloatArray, velocity: FloatArray, duration: FloatArray, start: Start, end: FloatArray
) -> NDArray[np.int8]:
    """Return the status of each element: the first that applies."""
    finite = np.isfinite(position).all(axis=1) & np.isfinite(velocity).all(axis=1) & np.isfinite(duration)
    first_that_applies = {
        KeplerStatus.OK: np.isfinite(end[0, :, 0]),
        KeplerStatus.NOT_FINITE: ~finite,
        KeplerStatus.AT_CENTRE: (position == 0.0).all(axis=1),
        KeplerStatus.OUT_OF_RANGE: ~np.isfinite(start.rate + start.sigma + start.alpha),
        KeplerStatus.PHASE_LOST: ~np.isfinite(start.time),
    }
    codes = [np.int8(code) for code in first_that_applies]
    return np.select(list(first_that_applies.values()), codes, np.int8(KeplerStatus.NOT_REACHED))


def _follow(start: Start, solver: Solver, end: FloatArray) -> BoolArray:
    """Write position and velocity at the end of each arc into `end`, (2, n, 3); return which the solver left."""
    arcs = start.arcs()
    at = np.flatnonzero(start.flies_by())
    if not at.size:
        solution, left = solver(arcs)
        _move(start, solution, end)
        return left
    part = start.at(at)
    distance, to_speed = part.scales()
    by = flybys(np.stack(part[:3]) / distance, np.stack(part[3:6]) * to_speed, part.alpha, part.time)
    arcs = Arcs(*(column.copy() for column in arcs))
    for column, some in zip(arcs, by.arcs(), strict=True):
        column[at] = some
    solution, left = solver(arcs)
    _move(start, solution, end)
    end_position, end_velocity = by.states(solution[:, at])
    end[0, at], end[1, at] = (end_position * distance).T, (end_velocity / to_speed).T
    return left


def _move(start: Start, solution: FloatArray, end: FloatArray) -> None:
    """Write position and velocity after the solved anomaly into `end`, (2, n, 3), by Lagrange's f and g."""
    x, y, z, vx, vy, vz, rate, back, sigma, _, _ = start
    _, g0, g1, g2 = solution
    ahead = g0 + sigma * g1
    r = ahead + g2
    f, g = 1.0 - g2, (g1 + sigma * g2) * back / rate
    f_rate, g_rate = g1 * back * rate / -r, ahead / r
    for row, (first, second) in enumerate(((f, g), (f_rate, g_rate))):
        for axis, (start_position, start_velocity) in enumerate(((x, vx), (y, vy), (z, vz))):
            np.add(first * start_position, second * start_velocity, out=end[row, :, axis])
